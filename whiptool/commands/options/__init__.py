"""Groups of options, of which every command is composed: it has those groups whose options it uses, and no others."""
