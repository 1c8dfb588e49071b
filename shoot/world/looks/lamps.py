"""Tags of the faces that shine, and how large the lamps of traffic lights are."""

TAIL_LAMP, HEAD_LAMP, HIGH_BRAKE_LAMP, STREET_LAMP = 1, 2, 3, 4
SIGNAL_LAMPS = 100  # tag of a signal's lamp: SIGNAL_LAMPS + 3 * signal + colour
# Real lamps measure 0.2 to 0.3 m and would be lost in images of 200 pixels a row; ours are 0.42 m.
SIGNAL_LAMP_RADIUS_M = 0.21
SIGNAL_LAMP_STEP_M = 0.46
