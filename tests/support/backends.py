"""Which renderers there are on this machine."""

from langwm_data.config_io import ConfigError
from langwm_data.sim import gl_device


def gl_opens():
    try:
        gl_device.gl_device(0)
    except ConfigError:
        return False
    return True
