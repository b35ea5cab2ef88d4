"""Bodies with a law in closed form, in place of finite elements."""


class Spring:
    """F = k u."""

    def __init__(self, stiffness=60.0):
        self.stiffness = stiffness

    def displacement(self, press, force_n):
        return force_n / self.stiffness

    def tangent(self, press, force_n):
        return self.stiffness
