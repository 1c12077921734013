"""Papers reproduced and compared with: configurations, claims, figures and verdicts, a folder for each.

It is no part of the package `whiptool`, which never imports it: it stands beside it in the repository.
"""
