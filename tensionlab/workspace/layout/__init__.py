"""Where to put the modules: the space they may stand in, the objective, the search, and what it found."""
