"""The inner loops of the Monte Carlo search: weights, the roulette wheel, and the noise.

A particle is a row (q, t): a quaternion wxyz and a translation, which move the object from the centre of the searched
space, R_PO = R_center R(q) and p_PO = p_center + t.

Source: [B16] J. Bimbo, thesis, 2016, sections 4.2.4 and 4.2.5.
"""
