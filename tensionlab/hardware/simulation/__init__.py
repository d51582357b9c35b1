"""Simulation: modules in this process or served by it, their links, and the motion that their cables hold."""
