"""From effects and brake targets to a demand: assignment, stability, passivity, locks."""
