import pytest

from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, build_config


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"robot": {"clearance_m": 0.5}}, r"robot\.clearance_m 0\.5 must be less than robot\.height_m 0\.45"),
        ({"camera": {"near_m": 41.0}}, r"camera\.near_m 41\.0 must be less than camera\.far_m 40\.0"),
        ({"splits": {"test_fraction": 1.5}}, r"field 'splits\.test_fraction': value 1\.5 is not allowed"),
        ({"frames": 0}, "field 'frames': value 0 is not allowed"),
        ({"frames": 10**20}, r"frames 10+ with shards\.samples_per_shard 1000 make more than 900000 shards"),
    ],
)
def test_values_that_do_not_fit_are_named(values, message):
    with pytest.raises(ConfigError, match=message):
        build_config(DatasetConfig, values)
