"""Experiments end to end: `reproduce` (the published one) and `demo`, from the stages that the other rooms offer."""
