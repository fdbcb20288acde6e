"""Sources that draw the walls of a world as seen by a camera, right and wrong."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Source
from rhs.api.geometry import camera_from_fov, inverse, planar, se2
from rhs.api.records import Capture, Twist

from . import settings

STEP = Twist(0.5, 0.1, 0.2)


class Honest(Source):
    """Flat walls, painted by where they are hit; drives as it is told."""

    def __init__(self, context):
        self.world, self.rng = context.world, context.rng
        self.camera = camera_from_fov(48, 24, 60.0, height_m=1.0)
        self.facts, self.views_expected = self.world.facts(), 6
        self.pose, self.at_s, self.count, self.last = se2(*self.world.start), 0.0, 0, None

    def lead(self):
        self.count += 1
        if self.count > self.views_expected:
            return None
        return self.look(None) if self.last is None else self.drive(STEP)

    def begin_patrol(self):
        pass

    def drive(self, command):
        self.pose = self.pose @ se2(*self.motion(command))
        self.at_s += command.duration_s
        return self.look(command)

    def motion(self, command):
        turn = command.turn_radps * command.duration_s
        way = command.forward_mps * command.duration_s
        return way * np.sinc(turn / np.pi), 0.5 * turn * way * np.sinc(0.5 * turn / np.pi) ** 2, turn

    def teleport(self, world_from_body):
        self.pose = np.array(world_from_body)

    def look(self, command):
        travel = None if self.last is None else planar(inverse(self.last) @ self.pose)
        self.last = self.pose
        image, depth = self.view()
        return Capture(self.count, self.stamp(), image, depth, command, travel)

    def stamp(self):
        return self.at_s

    def view(self):
        v, u = np.mgrid[0 : self.camera.height, 0 : self.camera.width]
        rays = self.camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
        rays = rays @ (self.pose @ self.camera.body_from_camera)[:3, :3].T
        eye = (self.pose @ self.camera.body_from_camera)[:3, 3]
        with np.errstate(divide="ignore"):
            depth = np.where(rays[:, 2] < 0, -eye[2] / rays[:, 2], np.inf)
            depth = np.fmin(depth, np.where(rays[:, 2] > 0, (3.0 - eye[2]) / rays[:, 2], np.inf))
        for wall in self.world.walls:
            for a, b in wall.segments_m:
                across = rays[:, 0] * (b - a)[1] - rays[:, 1] * (b - a)[0]
                with np.errstate(divide="ignore", invalid="ignore"):
                    reach = ((a - eye[:2])[0] * (b - a)[1] - (a - eye[:2])[1] * (b - a)[0]) / across
                    where = ((a - eye[:2])[0] * rays[:, 1] - (a - eye[:2])[1] * rays[:, 0]) / across
                depth = np.where((reach > 0) & (where >= 0) & (where <= 1) & (reach < depth), reach, depth)
        hit = eye + depth[:, None] * rays
        grey = (128 + 100 * np.sin(7 * hit[:, 0]) * np.cos(5 * hit[:, 1] + 3 * hit[:, 2])).reshape(u.shape)
        return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2), depth.reshape(u.shape).astype(np.float32)

    def truth(self):
        return self.pose.copy()

    def clearance_m(self):
        return 0.5, False

    def close(self):
        pass


class SameStamps(Honest):
    """Time stands still."""
    says = "stamps that increase"

    def stamp(self):
        return 5.0


class BackwardStamps(Honest):
    """Time runs backwards."""
    says = "stamps that increase"

    def stamp(self):
        return -self.at_s


class NoStamp(Honest):
    """Stamps of NaN."""
    says = "finite seconds"

    def stamp(self):
        return float("nan")


class Milliseconds(Honest):
    """Stamps in milliseconds."""
    says = "by the stamps"

    def stamp(self):
        return 1000.0 * self.at_s


class StampsBeginAgain(Honest):
    """The patrol's clock begins at 0."""
    says = "stamps that increase"

    def begin_patrol(self):
        self.at_s = -1.0


class TruthInverted(Honest):
    """body_from_world."""
    says = "the survey begins at"

    def truth(self):
        return inverse(self.pose)


class TruthOfTheCamera(Honest):
    """The pose of the camera, not of the body."""
    says = "the survey begins at"

    def truth(self):
        return self.pose @ self.camera.body_from_camera


class TruthFromTheStart(Honest):
    """The truth begins at the origin."""
    says = "the survey begins at"

    def truth(self):
        return inverse(se2(*self.world.start)) @ self.pose


class TruthInCentimetres(Honest):
    """True centimetres."""
    says = "the survey begins at"

    def truth(self):
        pose = self.pose.copy()
        pose[:3, 3] *= 100
        return pose


class TruthLate(Honest):
    """The truth of the view before."""
    says = "by truth() it moved"
    before = None

    def look(self, command):
        self.before = self.pose if self.last is None else self.last
        return super().look(command)

    def truth(self):
        return self.before.copy()


class TruthFlat(Honest):
    """x, y and yaw."""
    says = "world_from_body"

    def truth(self):
        return planar(self.pose)


class TravelInTheMap(Honest):
    """Travel in the axes of the world."""
    says = "travel of"

    def look(self, command):
        before = self.last
        capture = super().look(command)
        return capture if before is None else replace(capture, travel=planar(self.pose) - planar(before))


class TravelInverted(Honest):
    """Travel of the world, seen from the robot."""
    says = "travel of a view"

    def look(self, command):
        capture = super().look(command)
        return capture if capture.travel is None else replace(capture, travel=-capture.travel)


class TravelSummed(Honest):
    """Travel since the start."""
    says = "travel of a view"

    def look(self, command):
        capture = super().look(command)
        return replace(capture, travel=planar(inverse(se2(*self.world.start)) @ self.pose))


class DepthInMillimetres(Honest):
    """Depth in millimetres."""
    says = "of the depths of the middle row"

    def view(self):
        image, depth = super().view()
        return image, 1000 * depth


class DepthMirrored(Honest):
    """Depth from left to right."""
    says = "of the depths of the middle row"

    def view(self):
        image, depth = super().view()
        return image, depth[:, ::-1].copy()


class DepthAsRange(Honest):
    """The length of rays, through a wide lens."""
    says = "of the depths of the middle row"

    def __init__(self, context):
        super().__init__(context)
        self.camera = camera_from_fov(48, 24, 100.0, height_m=1.0)

    def view(self):
        image, depth = super().view()
        u = np.arange(self.camera.width)
        return image, (depth * np.hypot((u - self.camera.cx) / self.camera.fx, 1.0)).astype(np.float32)


class DepthOfIntegers(Honest):
    """Depth of 16 bits."""
    says = "float32 metres"

    def view(self):
        image, depth = super().view()
        return image, (1000 * np.minimum(depth, 60)).astype(np.uint16)


class WrongSize(Honest):
    """Images of half the camera's size."""
    says = "the camera has"

    def view(self):
        image, depth = super().view()
        return image[::2, ::2].copy(), depth[::2, ::2].copy()


class OneBuffer(Honest):
    """Every view is drawn into the same array."""
    says = "the image of the first view changed"
    buffer = None

    def view(self):
        image, depth = super().view()
        if self.buffer is None:
            self.buffer = np.zeros_like(image)
        self.buffer.setflags(write=True)
        self.buffer[:] = image
        return self.buffer, depth


class NoDepth(Honest):
    """Promises depth and has none."""
    says = "provides depth"

    def view(self):
        return super().view()[0], None


class Empty(Honest):
    """Has no view."""
    says = "lead() gave no view"

    def lead(self):
        return None


class TurnsRight(Honest):
    """Turns to the right when told to turn left."""
    says = "its motion"

    def motion(self, command):
        return super().motion(replace(command, turn_radps=-command.turn_radps))


class Doubles(Honest):
    """Drives twice as far."""
    says = "its motion"

    def motion(self, command):
        return super().motion(replace(command, forward_mps=2 * command.forward_mps))


class ForgetsDuration(Honest):
    """Drives for a second, whatever it was told."""
    says = "its motion"

    def motion(self, command):
        return super().motion(replace(command, duration_s=1.0))


class TurnsInDegrees(Honest):
    """Radians taken for degrees."""
    says = "its motion"

    def motion(self, command):
        return super().motion(replace(command, turn_radps=np.radians(command.turn_radps)))


class TurnsThenDrives(Honest):
    """Turns on the spot, then goes straight."""
    says = "its motion"

    def motion(self, command):
        x, _, turn = super().motion(replace(command, turn_radps=0.0))[0], 0, command.turn_radps * command.duration_s
        return x * np.cos(turn), x * np.sin(turn), turn


class DrivesNowhere(Honest):
    """Returns nothing from drive()."""
    says = "expected a Capture"

    def drive(self, command):
        capture = super().drive(command)
        return capture if command is STEP else None


class StaysWhereItIs(Honest):
    """teleport() does nothing."""
    says = "after teleport(pose)"

    def teleport(self, world_from_body):
        pass


class TeleportsBack(Honest):
    """teleport() moves the robot by a pose."""
    says = "after teleport(pose)"

    def teleport(self, world_from_body):
        self.pose = self.pose @ world_from_body


class Drunk(Honest):
    """Different at every run."""
    says = "two builds with one seed differ"

    def view(self):
        image, depth = super().view()
        return (image * np.random.default_rng().uniform(0.5, 1.0)).astype(np.uint8), depth


class Shared(Honest):
    """Noise from numpy's global generator."""
    says = "numpy's global generator"

    def view(self):
        image, depth = super().view()
        return image, (depth * np.random.uniform(0.999, 1.001, depth.shape)).astype(np.float32)  # noqa: NPY002


class Dice(Honest):
    """Noise from Python's global generator."""
    says = "Python's global generator"

    def stamp(self):
        return self.at_s + 1e-4 * random.random()


class NoClearance(Honest):
    """Says how near it came, not whether it touched."""
    says = "clearance_m() is 0.5"

    def clearance_m(self):
        return 0.5


class Slotted(Honest):
    """Loses the picture on the way to the patrol."""
    says = "RuntimeError"

    def begin_patrol(self):
        raise RuntimeError("no patrol")


WORDS = "image depth wheel command driving teleport"
HONEST = {"Honest": settings(Honest, "", WORDS)}
PLANTED = {part.__name__: (settings(part, "", WORDS), part.says) for part in Honest.__subclasses__()}
