"""Linear problems about the fit, and the ports of the chain."""
