"""The LEMON framework: Wang, Xiong, Tolu and Gorb 2024 (doi:10.1007/s42235-024-00534-2), in the paper's order.

`printed` holds what its text states. `fig5` shows the targets, `fig6` the trials that methods need to hit them, `fig7`
how learners are trained, `table4` the arm's tracking errors; `hard` asks for 1 cm everywhere, and `sim2real` is Figs. 9
and 10, on a twin in place of the rig.
"""
