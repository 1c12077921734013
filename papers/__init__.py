"""Papers reproduced and compared with: configurations, claims, figures and verdicts, a folder for each.

It is not part of the package `whiptool`, which never imports it, but next to it in the repository.
"""
