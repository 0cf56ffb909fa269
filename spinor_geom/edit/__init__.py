"""A window in which a person points at the holes that are to be filled."""
