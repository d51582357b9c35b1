"""What force to ask for: effects, their stability, and one-way brakes. Knows no device."""
