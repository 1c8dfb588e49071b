"""Closed loop: a driver's plans move a car through the city, whose cameras show where it came."""
