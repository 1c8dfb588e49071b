"""Light and weather of a scene as numbers: what the shading multiplies and adds."""

from dataclasses import dataclass

import numpy as np

from shoot.world.looks.meshes import Float32Array
from shoot.world.town.town import FloatArray
from shoot.world.traffic.recording import Look


@dataclass(frozen=True)
class Light:
    """Linear light, 1 being a white sheet in the sun at noon.

    Attributes:
        sun_direction: [3] unit vector towards the sun (or the brightest sky).
        sun_rgb, ambient_rgb: [3] direct light and light from all of the sky.
        horizon_rgb, zenith_rgb: [3] colours of the sky; haze takes the horizon's.
        haze_m: Distance over which contrast falls to 1/e.
        shadow: What is left of the light in a shadow of the sun, 0 to 1.
        are_lamps_lit: Whether cars drive with their lamps on.
        headlamps: What the ego's own lamps add to the light around; 0 where daylight drowns it.
        street_lamps: Strength of the lamp posts.
        lit_windows: Share of windows with light behind them.
        wetness: 0 dry, 1 wet: the road darkens and mirrors the sky.
        cloudiness: Contrast of clouds.
        noise: Standard deviation of the sensor noise, in display units 0 to 1.
        lamp_gain: How far lamps outshine a white sheet; also how wide they glow.
    """

    sun_direction: FloatArray
    sun_rgb: Float32Array
    ambient_rgb: Float32Array
    horizon_rgb: Float32Array
    zenith_rgb: Float32Array
    haze_m: float
    shadow: float
    are_lamps_lit: bool = False
    headlamps: float = 0.0
    street_lamps: float = 0.0
    lit_windows: float = 0.0
    wetness: float = 0.0
    cloudiness: float = 0.0
    noise: float = 0.008
    lamp_gain: float = 1.0


def light_of(look: Look) -> Light:
    """Turn a look into light; rain greys it, night leaves it to lamps."""
    heights_rad = {"day": np.deg2rad(42.0), "dusk": np.deg2rad(12.0), "night": np.deg2rad(60.0)}
    height_rad = heights_rad[look.daylight]
    flat = np.cos(height_rad)
    sun = np.array(
        [
            flat * np.cos(look.sun_azimuth_rad),
            flat * np.sin(look.sun_azimuth_rad),
            np.sin(height_rad),
        ]
    )

    def rgb(red: float, green: float, blue: float) -> Float32Array:
        return np.array([red, green, blue], np.float32)

    wetness = 1.0 if look.is_raining else 0.0
    if look.daylight == "night":
        return Light(
            sun_direction=sun,
            sun_rgb=rgb(0.006, 0.007, 0.011),
            ambient_rgb=rgb(0.034, 0.038, 0.056),
            horizon_rgb=rgb(0.030, 0.032, 0.046),
            zenith_rgb=rgb(0.006, 0.008, 0.017),
            haze_m=110.0 if look.is_raining else 170.0,
            shadow=1.0,
            are_lamps_lit=True,
            headlamps=1.0,
            street_lamps=1.0,
            lit_windows=0.35,
            wetness=wetness,
            noise=0.020,
            lamp_gain=1.3,
        )
    if look.is_raining:
        dim = 0.5 if look.daylight == "dusk" else 1.0
        return Light(
            sun_direction=sun,
            sun_rgb=dim * rgb(0.08, 0.08, 0.08),
            ambient_rgb=dim * rgb(0.56, 0.58, 0.62),
            horizon_rgb=dim * rgb(0.58, 0.61, 0.65),
            zenith_rgb=dim * rgb(0.40, 0.43, 0.48),
            haze_m=200.0,
            shadow=0.92,
            are_lamps_lit=True,
            headlamps=0.0 if dim == 1.0 else 0.15,
            street_lamps=0.0 if dim == 1.0 else 0.1,
            lit_windows=0.12,
            wetness=wetness,
            cloudiness=0.12,
            noise=0.012,
        )
    if look.daylight == "dusk":
        return Light(
            sun_direction=sun,
            sun_rgb=rgb(0.46, 0.28, 0.15),
            ambient_rgb=rgb(0.24, 0.24, 0.32),
            horizon_rgb=rgb(0.76, 0.50, 0.37),
            zenith_rgb=rgb(0.18, 0.22, 0.38),
            haze_m=330.0,
            shadow=0.6,
            are_lamps_lit=True,
            headlamps=0.15,
            street_lamps=0.12,
            lit_windows=0.22,
            cloudiness=0.25,
            noise=0.012,
            lamp_gain=1.1,
        )
    return Light(
        sun_direction=sun,
        sun_rgb=rgb(0.92, 0.86, 0.75),
        ambient_rgb=rgb(0.46, 0.50, 0.57),
        horizon_rgb=rgb(0.74, 0.81, 0.88),
        zenith_rgb=rgb(0.22, 0.39, 0.70),
        haze_m=520.0,
        shadow=0.48,
        cloudiness=0.3,
    )


def lit(
    rgb: Float32Array, normals: Float32Array, light: Light, sun_direction: FloatArray | None = None
) -> Float32Array:
    """Colours [F, 3] of matte faces under sun and sky; faces looking down get little sky."""
    sun = light.sun_direction if sun_direction is None else sun_direction
    direct = np.maximum(normals @ np.asarray(sun, np.float32), 0.0)[:, None]
    sky = (0.62 + 0.38 * normals[:, 2:3]).astype(np.float32)
    return np.asarray(rgb * (direct * light.sun_rgb + sky * light.ambient_rgb), np.float32)
