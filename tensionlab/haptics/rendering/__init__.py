"""From effects to a demand: assignment, filtering, stability, passivity."""
