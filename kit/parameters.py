"""Dimensions of the printed parts, in mm (N and MPa where a name says so), and where each comes from.

What is marked "measure yours" belongs to a part that is bought and differs from maker to maker: measure it before
printing. The motor's axis is the z axis, z = 0 is the underside of the bracket, and the cable leaves towards +x.
"""

import math

# What the firmware knows; a test holds these to its standard parameters.
spool_radius = 19.5  # firmware: spool_radius, to the middle of the cable
cable_length = 5000.0  # firmware: length_upper, in one layer on the spool
cable_per_tooth = 3.0  # firmware: brake_tooth; the whole number of teeth that comes closest is used
brake_strength_n = 186.0  # publication: beyond which the pawl slips; here, what the brake must hold
highest_tension_n = 12.0  # firmware: the most that tension_upper may be set to

# Bought parts.
motor_diameter = 40.0  # measure yours: the rotor
motor_height = 18.0  # measure yours: from the face with the stator's screws to the rotor's top
motor_bearings = 12.0  # measure yours: between the middles of its two bearings, half way up
motor_bore = 7.0  # measure yours: hollow shaft, at the stator's end
stator_hole_circle = 19.0  # measure yours: diameter through the stator's screws
stator_hole = 2.4  # measure yours: clearance for its screws, M2
stator_screws = 4  # measure yours: their number
rotor_hole_circle = 16.0  # measure yours: diameter through the rotor's screws
rotor_hole = 2.4  # measure yours: clearance for its screws, M2
rotor_screws = 4  # measure yours: their number
magnet_diameter = 6.0  # measure yours: the encoder's magnet
magnet_height = 2.5  # measure yours: the encoder's magnet
encoder_board = 22.0  # measure yours: side of the encoder's board, its chip in the middle
encoder_hole_pitch = 17.0  # measure yours: between its screws, M2
encoder_chip = 1.1  # measure yours: height of the chip above its board
encoder_gap = 1.5  # data sheet: 0.5 to 2.5 between chip and magnet
servo_length = 23.0  # measure yours: body, without ears
servo_width = 12.2  # measure yours: body
servo_height = 23.0  # measure yours: body, without shaft
servo_ears = 32.5  # measure yours: from end to end of the ears
servo_ear_height = 16.0  # measure yours: from the bottom to the underside of the ears
servo_hole_pitch = 28.0  # measure yours: between the ears' screws
servo_shaft = 5.6  # measure yours: from the end of the body to the shaft
horn_radius = 11.0  # measure yours: from shaft to the end of the horn
horn_width = 4.0  # measure yours: of the horn's end
horn_height = 11.0  # measure yours: from the underside of the ears to that of the horn
horn_thickness = 2.0  # measure yours: of the horn
eyelet_diameter = 8.0  # measure yours: ceramic ring of a fishing rod, outside
eyelet_height = 3.0  # measure yours: along the cable
cable_diameter = 0.4  # measure yours: braided polyethylene that breaks above 300 N

# Printing.
clearance = 0.3  # between printed parts that move or slide
minimum_wall = 1.2  # three lines of a nozzle of 0.4
screw_m2 = 1.7  # hole that an M2 screw cuts its thread into
screw_m3 = 2.6  # hole that an M3 screw cuts its thread into
through_m2 = 2.4  # hole that an M2 screw passes
through_m3 = 3.4  # hole that an M3 screw passes

# Spool.
groove_pitch = 0.45  # a turn of the cable and the gap to the next
groove_width = groove_pitch * math.ceil(cable_length / (2 * math.pi * spool_radius))  # one layer
spool_wall = 2.4  # six lines
spool_floor = 3.0  # takes the heads of the screws that hold the ratchet
flange_radius = 22.5  # of the upper end: seven layers above the core
flange_rim = 1.2  # minimum wall

# One-way brake.
teeth = round(2 * math.pi * spool_radius / cable_per_tooth)  # 41: 2.99 mm of cable each
ratchet_inside = motor_diameter / 2 + 1.0  # turns around the motor
root_radius = 26.0  # leaves 1.6 beside the screws
tooth_height = 2.2  # what strength leaves
tooth_undercut = 12.0  # degrees: pulls the pawl in
ratchet_width = 10.0  # along the axis, for strength
ratchet_screws = 6  # M2 x 8, through the spool's floor
ratchet_screw_radius = 23.5  # in the middle of the rim
pawl_tooth = 3.8  # its base, at the tips of the ratchet
pawl_depth = 0.85  # of the tooth height that the pawl reaches down
pawl_length = 24.0  # along the cable, from tooth to pin
pawl_offset = 3.0  # of the pin, outwards from the tooth
pawl_height = 7.0  # of the arm
pawl_tail = 15.0  # from the pin to where the horn pushes
pawl_lift = 9.0  # degrees that lift the pawl off the teeth
spring_x = 45.0  # of the hole for the pawl's spring
spring_post = (52.0, -34.5)  # where the spring hangs
horn_lifts = 90.0  # degrees of the horn that holds the pawl lifted, without torque
horn_free = 150.0  # degrees of the horn that lets the pawl down
pin_diameter = 5.0  # steel
boss_diameter = 14.0  # around the pin, for strength

# Bracket.
bracket_thickness = 4.0  # screws of the stator hold 4 mm
pedestal = 4.0  # under the motor: room for magnet and chip
servo_pedestal = 4.0  # under its ears: brings the horn to the pawl
left, right, front, back = -38.0, 64.0, -66.0, 38.0  # edges of bracket, housing and cover, from the axis
corner = 5.0  # of the screws, from the edges

# Housing.
wall = 2.0  # five lines
electronics = 36.0  # inside height: shield on a stack of 20 beside the ESP32
post = 10.0  # side of the posts that take the screws
strap_width = 26.0  # webbing of 25
strap_slot = 4.0  # webbing, doubled
ear = 16.0  # beyond the housing, each side
cover_gap = 3.0  # between the spool's end and the cover

# Breakaway link.
neck = 1.2  # side of the square that breaks
link_thickness = 3.0  # stiff beside the neck
eye_diameter = 5.0  # for a knot or a small carabiner

# Material. Printed PETG at 52 % of its bulk strength, as printed PLA was measured to keep of its own.
bulk_strength_mpa = 50.0  # PETG, tension: Processes 13 (2025) 2733
printed_strength_mpa = 26.0  # 52 % of it: 3D Printing and Additive Manufacturing, doi 10.1089/3dp.2020.0109
layer_strength_mpa = 22.8  # across layers, measured on PLA: same source
strength_factor = 2.0  # that every part of the brake must have over 186 N
friction = 0.3  # of PETG on PETG, the most to expect; the pawl must not slip out at it

# Heights, from the above.
motor_base = bracket_thickness + pedestal
motor_top = motor_base + motor_height
ratchet_base = motor_top - ratchet_width
cable_height = motor_top + spool_floor + groove_width / 2
core_radius = spool_radius - cable_diameter / 2
spool_top = motor_top + spool_floor + groove_width + (flange_radius - core_radius) + flange_rim
tip_radius = root_radius + tooth_height
magnet_face = encoder_chip + encoder_gap
horn_base = bracket_thickness + servo_pedestal + horn_height
shaft_x = pawl_length + pawl_tail
shaft_y = -(root_radius + tooth_height / 2 + pawl_offset) - 14.2  # the horn's end below the lifted tail
pin_x, pin_y = pawl_length, -(root_radius + tooth_height / 2 + pawl_offset)
