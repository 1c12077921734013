"""People and machines that strike with a whip: Krotov, Russo, Nah, Hogan and Sternad 2022 (doi:10.1098/rsos.220581).

The data are theirs and the user's copy is read: nothing of it is part of whiptool.
"""
