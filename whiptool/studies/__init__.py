"""Studies: methods compared over targets and seeds, and the figures and tables of the paper."""
