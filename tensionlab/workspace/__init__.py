"""Where, and how well, can a rig pull?"""
