"""The web server of a Meshcat, which listens on this machine alone unless asked otherwise."""

from pydrake.geometry import Meshcat, MeshcatParams

from uvms_drake.common.errors import InvalidParameter

LOCAL = "localhost"
"""Address that only programs of this machine reach."""


def open_meshcat(host: str = LOCAL) -> Meshcat:
    """Returns a new Meshcat that listens at an address of this machine.

    Drake's default is every interface, where the whole network can press the buttons of a run.

    Args:
        host: Name or number of the address; `*` for every interface.

    Raises:
        InvalidParameter: Nothing can listen there.
    """
    try:
        return Meshcat(MeshcatParams(host=host))
    except RuntimeError as error:
        raise InvalidParameter("host", host, "an address of this machine with a free port, or '*' "
                               f"({error})") from None
