"""Where the file of a mesh is."""

from pathlib import Path
from urllib.parse import unquote, urlsplit


def mesh_path(name: str, urdf: Path) -> Path:
    """The file that a URDF names, relative to the folder of the URDF.

    "package://arm/meshes/a.stl" is searched in the folders above the URDF: as `arm/meshes/a.stl` below one of them, or
    as `meshes/a.stl` in one that is called `arm`.
    """
    folder = urdf.resolve().parent
    try:
        address = urlsplit(name)
    except ValueError:  # no address: a file of this name
        return folder / name
    if address.scheme not in ("package", "model"):
        return folder / (unquote(address.path) if address.scheme == "file" else name)
    inside = Path(address.netloc, unquote(address.path).lstrip("/"))
    found = (above / inside for above in (folder, *folder.parents))
    return next((path for path in found if path.is_file()), folder / inside)
