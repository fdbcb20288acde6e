"""What is solid, as PyBullet judges it: boxes for walls and furniture, a cylinder for a round robot, else its footprint
as tall as it is.

Kept in a client of its own: PyBullet draws every solid body that has no picture, in front of those that have.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rhs.api.floorplan import Box, Person, Wall, World
from rhs.worlds.live import Stand, shapes_of

from .simulator_bullet import Client, pybullet

WALL_HALF_THICKNESS_M = 0.001  # solid walls are 2 mm thick, so that distances to them are right to a millimetre
SLACK_M = 1e-3  # PyBullet's shapes have margins of less than this
FAR_ENOUGH_M = 3.0  # distances beyond this are not looked for


class Solid(Client):
    """The solid world and the robot in it. `close` it."""

    def __init__(self, world: World) -> None:
        super().__init__()
        self.world = world
        self.bodies: list[int] = []
        self.rounds: list[tuple[float, float, float]] = []  # of each body: its middle, and how far it reaches from there
        for wall in world.walls:
            for number in range(len(wall.segments_m)):
                self._add_wall(wall, number)
        for box in world.boxes:
            self._add_box(box)
        self.moving = range(len(self.bodies), len(self.bodies) + len(shapes_of(world.moving)))
        for shape in shapes_of(world.moving):
            if isinstance(shape, Person):
                self._add_person(shape)
            else:
                self._add_box(shape)
        self.robot = self._robot()
        self.stands: list[Stand] = []  # of what moves, once it was placed
        self._known: tuple[tuple[float, ...], float] = (), np.nan  # what was asked last, while nothing moves, and the answer

    def __reduce__(self) -> tuple[Any, ...]:
        """In another process it is built anew."""
        return _rebuilt, (self.world, self.stands)

    def _add_box(self, box: Box) -> None:
        w, d, h = box.size_m
        self._add((w / 2, d / 2, h / 2), (*box.centre_m, box.bottom_m + h / 2), box.yaw_rad)

    def _add_wall(self, wall: Wall, number: int) -> None:
        a, b = wall.segments_m[number]
        half = (0.5 * float(np.hypot(*(b - a))), WALL_HALF_THICKNESS_M, 0.5 * wall.height_m)
        self._add(half, (*(0.5 * (a + b)), 0.5 * wall.height_m), float(np.arctan2(*(b - a)[::-1])))

    def _add_person(self, person: Person) -> None:
        radius = 0.5 * person.width_m
        shape = pybullet.createCollisionShape(pybullet.GEOM_CYLINDER, radius=radius, height=person.height_m,
                                              physicsClientId=self.client)
        self.rounds.append((0.0, 0.0, radius))
        self.bodies.append(pybullet.createMultiBody(0, shape, -1, [0.0, 0.0, 0.5 * person.height_m],
                                                    physicsClientId=self.client))

    def place(self, stands: list[Stand]) -> None:
        """Put what moves (rhs.worlds.live.shapes_of) where it is now."""
        self.stands, self._known = stands, ((), np.nan)
        for number, shape, stand in zip(self.moving, shapes_of(self.world.moving), stands, strict=True):
            height = shape.height_m if isinstance(shape, Person) else shape.size_m[2]
            turn = [0.0, 0.0, float(np.sin(0.5 * stand.yaw_rad)), float(np.cos(0.5 * stand.yaw_rad))]
            self.rounds[number] = (stand.x_m, stand.y_m, self.rounds[number][2])
            middle = [stand.x_m, stand.y_m, stand.bottom_m + 0.5 * height]
            pybullet.resetBasePositionAndOrientation(self.bodies[number], middle, turn, physicsClientId=self.client)

    def _add(self, half_m, middle_m, yaw_rad: float) -> None:
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=list(half_m), physicsClientId=self.client)
        turn = pybullet.getQuaternionFromEuler([0.0, 0.0, yaw_rad])
        self.rounds.append((middle_m[0], middle_m[1], float(np.hypot(half_m[0], half_m[1]))))
        self.bodies.append(pybullet.createMultiBody(0, shape, -1, list(middle_m), turn, physicsClientId=self.client))

    def _robot(self) -> int:
        height = self.world.camera_height_m
        if self.world.footprint is None:
            shape = pybullet.createCollisionShape(pybullet.GEOM_CYLINDER, radius=self.world.robot_radius_m, height=height,
                                                  physicsClientId=self.client)
        else:
            corners = [(x, y, z) for z in (-0.5 * height, 0.5 * height) for x, y in self.world.footprint.corners_m]
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=corners, physicsClientId=self.client)
        return pybullet.createMultiBody(1, shape, -1, [0, 0, -100], physicsClientId=self.client)

    def distance_m(self, x_m: float, y_m: float, yaw_rad: float = 0.0, *, within_m: float = FAR_ENOUGH_M) -> float:
        """Distance from the robot's side to the nearest solid thing, if it stood there; negative: overlapping. yaw_rad
        counts where it is not round. `within_m` when nothing is nearer than that."""
        asked = x_m, y_m, yaw_rad if self.world.footprint else 0.0, within_m
        if self._known[0] != asked:
            self._known = asked, self._measured_m(*asked)
        return self._known[1]

    def _measured_m(self, x_m: float, y_m: float, yaw_rad: float, within_m: float) -> float:
        middle = 0.5 * self.world.camera_height_m + 1e-3
        turn = [0.0, 0.0, float(np.sin(0.5 * yaw_rad)), float(np.cos(0.5 * yaw_rad))]
        pybullet.resetBasePositionAndOrientation(self.robot, [x_m, y_m, middle], turn, physicsClientId=self.client)
        nearest = within_m
        gaps = self._gaps_at_least(x_m, y_m)
        for number in np.argsort(gaps, kind="stable"):
            if gaps[number] > nearest:
                break
            for contact in pybullet.getClosestPoints(self.robot, self.bodies[number], nearest, physicsClientId=self.client):
                nearest = min(nearest, contact[8])
        return min(nearest, self._from_mesh(x_m, y_m, yaw_rad, within_m))

    def _gaps_at_least(self, x_m: float, y_m: float) -> np.ndarray:
        """(N,) metres from the robot's side that no body is nearer than: seen from above, a body lies in a circle."""
        middles = np.array(self.rounds).reshape(-1, 3)
        away = np.hypot(middles[:, 0] - x_m, middles[:, 1] - y_m)
        return away - middles[:, 2] - self.world.robot_radius_m - SLACK_M

    def _from_mesh(self, x_m: float, y_m: float, yaw_rad: float, within_m: float) -> float:
        """The same to the mesh of somebody else's building if there is one, seen from above: what is in the way of an
        upright robot, cut at its height."""
        if self.world.mesh is None:
            return within_m
        from rhs.api.footprints import nearest_m

        if self.world.footprint is not None:
            return self.world.footprint.gap_to_m(self.world.mesh.solid_m, (x_m, y_m, yaw_rad), within_m)
        radius_m = self.world.robot_radius_m
        gap_m: float = nearest_m(self.world.mesh.solid_m, x_m, y_m, within_m + radius_m) - radius_m
        return gap_m


def _rebuilt(world: World, stands: list[Stand]) -> Solid:
    solid = Solid(world)
    if stands:
        solid.place(stands)
    return solid
