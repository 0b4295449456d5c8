"""The nasal airway in a CT: found, cut from what it is open to, and divided."""
