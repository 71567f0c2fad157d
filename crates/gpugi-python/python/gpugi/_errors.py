"""What can go wrong. The messages are those of the command."""


class Error(Exception):
    """The base of all errors that gpugi raises."""


class ArgumentError(Error, ValueError):
    """An argument that makes no sense; the message names it."""


class SceneError(Error):
    """A file that cannot be read as a scene or an image; the message says where in the file, and why."""


class GpuError(Error):
    """The GPU failed, is missing, or does not hold the scene."""
