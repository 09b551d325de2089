"""A scene: meshes that know what they are, ready for rays."""

from dataclasses import dataclass, field
from typing import Any

from bushseg.geometry import open3d
from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Mesh, Model

CLASS_CODES = {
    "ground": 2,
    "low vegetation": 3,
    "bush": 4,
    "tree": 5,
    "building": 6,
    "man-made": 64,
    "vehicle or person": 65,
}
"""Class names to the codes that scans carry."""


@dataclass(frozen=True, slots=True)
class Part:
    """One mesh of a scene.

    Attributes:
        mesh: Its triangles, metres from the site's origin.
        material: What it is made of.
        class_code: A value of `CLASS_CODES`.
        instance: The thing it belongs to, counted from 1; 0 for ground and grass.
    """

    mesh: Mesh
    material: Material
    class_code: int
    instance: int


@dataclass(slots=True)
class Scene:
    """All parts of a site; a part's place in the list is its geometry id when rays are cast.

    Attributes:
        parts: The parts, in the order they were added.
        num_instances: How many things were added as instances.
    """

    parts: list[Part] = field(default_factory=list)
    num_instances: int = 0

    def add(self, model: Model, class_name: str, *, instance: bool = True) -> None:
        """Add a model where it stands.

        Args:
            model: Its surfaces, metres from the site's origin.
            class_name: A key of `CLASS_CODES`.
            instance: Whether it is a thing of its own; ground and grass are not.
        """
        code = CLASS_CODES[class_name]
        self.num_instances += instance
        number = self.num_instances if instance else 0
        self.parts.extend(Part(mesh, material, code, number) for mesh, material in model)

    def caster(self) -> Any:
        """Build Open3D's `RaycastingScene` with one geometry a part, in order."""
        o3d = open3d()
        scene = o3d.t.geometry.RaycastingScene()
        for part in self.parts:
            scene.add_triangles(
                o3d.core.Tensor.from_numpy(part.mesh.vertices),
                o3d.core.Tensor.from_numpy(part.mesh.triangles),
            )
        return scene
