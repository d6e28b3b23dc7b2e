"""Controls and tables of which the panels are made."""
