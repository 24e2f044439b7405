"""The names that other rooms use. `_doors` loads their modules when they are used."""

from .document import Tag as Tag, read_document as read_document
from .mjcf_file import load_mjcf as load_mjcf
from .robot import LinkFrame as LinkFrame, Robot as Robot
from .urdf_file import load_urdf as load_urdf
