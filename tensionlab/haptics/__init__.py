"""What force to ask for: effects, and what keeps them stable. Knows no solver and no device."""
