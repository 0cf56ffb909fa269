"""Derivatives of minimal surfaces with respect to the points of their boundary curves.

Here a name `by_x` is the gradient of one scalar function with respect to x. A function `by_x` returns it from the
gradients with respect to quantities that depend on x: it is one step of the chain rule, from the result backwards.
"""
