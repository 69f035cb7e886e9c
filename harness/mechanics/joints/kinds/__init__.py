"""The kinds of joints, one file each: the user's input, the rows as equations, the sentences of the manual.

In the equations d = r_i + R_i s_i - r_j - R_j s_j; u, w are fixed in body i, n_1, n_2, n_3 in body j.
"""
