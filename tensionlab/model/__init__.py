"""The rig: geometry and limits. Knows no solver and no device."""
