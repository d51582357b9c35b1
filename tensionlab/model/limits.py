"""How much a cable may be pulled: `TensionLimits`."""
