"""Tests, a package: one of the same name that another installed package brings does not take its place."""
