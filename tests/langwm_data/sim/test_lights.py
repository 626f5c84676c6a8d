"""Colours of black bodies against published ones, and lights that stay within their limits."""

import numpy as np
import pytest

from langwm_data.config import DatasetConfig, LightsConfig, RandomizeConfig
from langwm_data.config_io import ConfigError, build_config
from langwm_data.sim.lights import Lights, black_body_tint, chromaticity, sample_lights


def test_illuminant_a_has_its_published_chromaticity():
    # A black body at 2856 K by definition. Source: CIE 015 (illuminant A).
    assert chromaticity(2856) == pytest.approx((0.44757, 0.40745), abs=2e-3)


def test_both_halves_of_the_locus_meet():
    assert chromaticity(4000) == pytest.approx(chromaticity(4000.001), abs=2e-4)


def test_warm_light_is_red_and_cold_light_blue():
    warm, white, cold = (black_body_tint(k) for k in (3000, 6500, 12000))
    assert warm[0] == 1 > warm[1] > warm[2]
    assert min(white) > 0.93
    assert cold[2] == 1 > cold[1] > cold[0]


def test_drawn_lights_stay_within_their_limits():
    rng, config, randomize = np.random.default_rng(0), LightsConfig(), RandomizeConfig()
    for lights in (sample_lights(rng, config, randomize) for _ in range(100)):
        for strength, color in zip(
            (config.ambient, config.sun, config.lamp), (lights.ambient, lights.sun, lights.lamp), strict=True
        ):
            assert 0.6 * strength <= max(color) <= 1.2 * strength
        assert np.linalg.norm(lights.sun_direction) == pytest.approx(1)
        assert lights.sun_direction[2] > 0.4
        assert Lights.parse(lights.describe()) == lights


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"randomize": {"light_factor": [1.2, 0.6]}}, r"randomize\.light_factor.*give the lower limit first"),
        ({"randomize": {"light_temperature_k": [1000, 6500]}}, r"randomize\.light_temperature_k"),
        (
            {"randomize": {"lights": "frame"}, "render": {"backend": "tiny"}},
            r"randomize\.lights frame needs render\.backend auto, gl or embree",
        ),
    ],
)
def test_lights_that_cannot_be_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        build_config(DatasetConfig, values)
