"""What a rig and its modules really are, from what was measured on them: newton per ampere, and the anchors."""
