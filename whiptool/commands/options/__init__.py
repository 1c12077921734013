"""Groups of options; a command is composed of the groups that it uses."""
