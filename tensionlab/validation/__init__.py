"""The published technical validation, on simulated modules or real ones.

Four modules pull on a force sensor; 182 forces of 1.5 N are commanded one after another, and what the sensor
shows is compared with what was asked for. Bartels et al. 2026, "Rendering Forces With a Modular Cable System,
Motors, and Brakes", arXiv 2603.08054.
"""
