"""The studio: a page on which a target is dragged, numbers are changed, and the strike follows.

What is computed (`session` and the modules that it uses) knows nothing of the page, and what is shown (`scene`,
`panel`) computes nothing.
"""
