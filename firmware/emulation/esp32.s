# Vectors of windowed calls, start, and calls of the simulator, for the emulated Xtensa (firmware/emulation/esp32.cpp).
# Register spills follow the Xtensa ISA reference manual, "Windowed register option". Bytes are instructions that this
# assembler refuses: writing CPENABLE, the simulator's call, reading CCOUNT.
  .section .text.vectors,"ax"
  .global vectors
  .p2align 10
vectors:
  s32e a0, a5, -16
  s32e a1, a5, -12
  s32e a2, a5, -8
  s32e a3, a5, -4
  rfwo
  .p2align 6
uf4:
  l32e a0, a5, -16
  l32e a1, a5, -12
  l32e a2, a5, -8
  l32e a3, a5, -4
  rfwu
  .p2align 6
  s32e a0, a9, -16
  l32e a0, a1, -12
  s32e a1, a9, -12
  s32e a2, a9, -8
  s32e a3, a9, -4
  s32e a4, a0, -32
  s32e a5, a0, -28
  s32e a6, a0, -24
  s32e a7, a0, -20
  rfwo
  .p2align 6
uf8:
  l32e a0, a9, -16
  l32e a1, a9, -12
  l32e a2, a9, -8
  l32e a7, a1, -12
  l32e a3, a9, -4
  l32e a4, a7, -32
  l32e a5, a7, -28
  l32e a6, a7, -24
  l32e a7, a7, -20
  rfwu
  .p2align 6
  s32e a0, a13, -16
  l32e a0, a1, -12
  s32e a1, a13, -12
  s32e a2, a13, -8
  s32e a3, a13, -4
  s32e a4, a0, -48
  s32e a5, a0, -44
  s32e a6, a0, -40
  s32e a7, a0, -36
  s32e a8, a0, -32
  s32e a9, a0, -28
  s32e a10, a0, -24
  s32e a11, a0, -20
  rfwo
  .p2align 6
uf12:
  l32e a0, a13, -16
  l32e a1, a13, -12
  l32e a2, a13, -8
  l32e a11, a1, -12
  l32e a3, a13, -4
  l32e a4, a11, -48
  l32e a5, a11, -44
  l32e a6, a11, -40
  l32e a7, a11, -36
  l32e a8, a11, -32
  l32e a9, a11, -28
  l32e a10, a11, -24
  l32e a11, a11, -20
  rfwu
  .org 0x340
  wsr a0, excsave1
  rsr a0, windowbase
  rotw -1
  rsr a2, ps
  extui a3, a2, 8, 4
  xor a3, a3, a4
  rsr a4, excsave1
  slli a3, a3, 8
  xor a2, a2, a3
  wsr a2, ps
  rsync
  bbsi a4, 31, 1f
  j uf4
1:
  rotw -1
  bbsi a8, 30, 2f
  j uf8
2:
  rotw -1
  j uf12
  .section .text.start,"ax"
  .global start
  .p2align 2
start:
  movi a2, 0
  wsr a2, windowbase
  rsync
  movi a2, 1
  wsr a2, windowstart
  rsync
  movi a2, 32
  slli a3, a2, 13
  or a2, a2, a3
  wsr a2, ps
  rsync
  movi a2, 255
  .byte 0x20, 0xe0, 0x13
  rsync
  movi a1, 1024
  slli a1, a1, 12
  movi a2, 1
  slli a2, a2, 12
  wsr a2, vecbase
  rsync
  movi a0, 0
  call8 bench
  movi a3, 0
  movi a2, 1
  .byte 0x00, 0x51, 0x00
.Lend:
  j .Lend
  .section .text.sim_write,"ax"
  .global sim_write
  .p2align 2
sim_write:
  entry a1, 32
  mov a5, a3
  mov a4, a2
  movi a3, 1
  movi a2, 4
  .byte 0x00, 0x51, 0x00
  retw
  .section .text.cycle_count,"ax"
  .global cycle_count
  .p2align 2
cycle_count:
  entry a1, 32
  .byte 0x20, 0xea, 0x03
  retw
  .section .text.fmaf,"ax"
  .global fmaf
  .p2align 2
fmaf:
  entry a1, 32
  wfr f0, a2
  wfr f1, a3
  wfr f2, a4
  madd.s f2, f0, f1
  rfr a2, f2
  retw
