"""Published technical validation, on simulated modules or real ones.

Four modules pull on a force sensor; 182 forces of 1.5 N are commanded one after another, and the measured forces
are compared with the desired ones. Bartels et al. 2026, "Rendering Forces With a Modular Cable System, Motors, and
Brakes", arXiv 2603.08054.
"""
