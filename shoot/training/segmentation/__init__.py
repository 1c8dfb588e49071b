"""Segmentation: which cells of the map are a car, a vehicle, road, a lane's boundary."""
