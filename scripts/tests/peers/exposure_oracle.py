"""The camera model once more, in NumPy and SciPy: slow, and plain to see.

`python exposure_oracle.py FILM.f32 OUT.f32 SETTINGS.json` reads the red, green and blue radiance of
a film, and a camera as a recipe has it, and writes the light on the pixels, then the digital
numbers of one photograph. It prints how long the photograph took [s]: the median of several.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
from scipy.ndimage import correlate1d
from scipy.special import ndtr


def ramp(x, sigma):
    """Return the twofold integral of a normal distribution's density."""
    return x * ndtr(x / sigma) + sigma * np.exp(-0.5 * (x / sigma) ** 2) / np.sqrt(2.0 * np.pi)


def weights(scale, sigma_px, fill_factor, phase_px):
    """Return the first cell that counts, from pixel 0's first one, and the weights of cells."""
    sigma, aperture = scale * sigma_px, scale * np.sqrt(fill_factor)
    centre = (0.5 + phase_px) * scale
    reach = 0.5 * aperture + 6.0 * sigma + 1.0
    cells = np.arange(np.floor(centre - reach), np.ceil(centre + reach))
    outer, inner = 0.5 * (1.0 + aperture), 0.5 * (1.0 - aperture)
    x = cells + 0.5 - centre
    found = ramp(x + outer, sigma) - ramp(x + inner, sigma)
    found -= ramp(x - inner, sigma) - ramp(x - outer, sigma)
    return int(cells[0]), found / found.sum()


def light(film, settings):
    """Return the light on the pixels, of shape (3, height, width)."""
    scale = settings["oversampling"]
    for axis, phase_px in ((1, settings["phase_px"][1]), (2, settings["phase_px"][0])):
        optics = settings["camera"]["optics"]
        sigma_px, fill_factor = optics["gaussian_sigma_px"], optics["fill_factor"]
        first, found = weights(scale, sigma_px, fill_factor, phase_px)
        before, after = -first, first + len(found) - scale
        padding = [(0, 0)] * 3
        padding[axis] = (max(before, 0) + len(found), max(after, 0) + len(found))
        padded = np.pad(film, padding, mode="edge")
        summed = correlate1d(padded, found, axis=axis, origin=-(len(found) // 2), mode="nearest")
        start = padding[axis][0] + first
        film = np.take(summed, range(start, start + film.shape[axis], scale), axis=axis)
    return film


def electrons_at_one(sensor):
    """Return the mean electrons of each colour where the radiance is 1.

    EMVA 1288, equations 2 to 4; a photon's energy is h c / wavelength.
    """
    energy_j = 6.626_070_15e-34 * 299_792_458.0 / (1e-9 * np.array(sensor["wavelength_nm"]))
    area_cm2 = (1e-4 * sensor["pixel_pitch_um"]) ** 2
    exposure_j = 1e-6 * sensor["irradiance_uw_cm2"] * area_cm2 * 1e-3 * sensor["exposure_time_ms"]
    return np.array(sensor["quantum_efficiency"]) * exposure_j / energy_j


def numbers(light_e, sensor, random):
    """Return the digital numbers of mean electrons."""
    dark_e = 1e-3 * sensor["exposure_time_ms"] * sensor["dark_current_e_per_s"]
    light_e = light_e * (1.0 + sensor["prnu"] * random.standard_normal(light_e.shape))
    electrons = random.poisson(np.maximum(light_e, 0.0) + dark_e).astype(float)
    electrons = np.minimum(electrons, sensor["full_well_e"])
    electrons += sensor["dsnu_e"] * random.standard_normal(light_e.shape)
    electrons += sensor["read_noise_e"] * random.standard_normal(light_e.shape)
    raw = np.round(sensor["black_level_dn"] + sensor["gain_dn_per_e"] * electrons)
    return np.clip(raw, 0, 2 ** sensor["bit_depth"] - 1)


def main():
    """Photograph."""
    film_file, output, settings_file = map(Path, sys.argv[1:])
    settings = json.loads(settings_file.read_text())
    side = settings["side_px"] * settings["oversampling"]
    film = np.fromfile(film_file, "<f4").reshape(3, side, side).astype(float)

    def photograph():
        """Return light and numbers."""
        on_pixels = light(film, settings)
        sensor = settings["camera"]["sensor"]
        electrons = on_pixels * electrons_at_one(sensor)[:, None, None]
        return on_pixels, numbers(electrons, sensor, np.random.default_rng(1))

    np.stack(photograph()).astype("<f4").tofile(output)
    took_s = []
    for _ in range(settings["repeats"]):
        begun_s = time.perf_counter()
        photograph()
        took_s.append(time.perf_counter() - begun_s)
    print(np.median(took_s))


main()
