"""SE(2), SE(3), the pinhole camera and rigid alignment.

Poses are 4x4 homogeneous matrices, float64, named `a_from_b`: `p_a = a_from_b @ p_b`.
Covariances of poses are 6x6 in the order (x, y, z, rx, ry, rz), metres and radians, of the *right* perturbation
`a_from_b @ exp(delta)`: they are expressed in frame b.
Body frame: x forward, y left, z up, on the floor under the robot. Camera frame: x right, y down, z forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .distortion import distorted, undistorted
from .frozen import Shown

# Rotation taking camera axes (right, down, forward) to body axes (forward, left, up).
BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
EYE = np.eye(3)


def wrap(angle_rad: float | np.ndarray) -> Any:
    """Angle, or array of angles, brought to [-pi, pi)."""
    return (np.asarray(angle_rad) + np.pi) % (2.0 * np.pi) - np.pi


def _length(v: np.ndarray) -> float:
    """Of a vector, as np.linalg.norm has it, to the last bit and four times as fast."""
    return math.sqrt(v.dot(v))


def hat(v: np.ndarray) -> np.ndarray:
    """3x3 matrix of the cross product: `hat(v) @ w == cross(v, w)`."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def se2(x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
    """4x4 pose of a body standing on the floor at (x, y) with heading yaw."""
    return se3(rotation_z(yaw_rad), np.array([x_m, y_m, 0.0]))


def planar(pose: np.ndarray) -> np.ndarray:
    """(3,) x, y, yaw of a 4x4 pose: its shadow on the floor."""
    return np.array([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])


def arc(length_m: float, turn_rad: float) -> np.ndarray:
    """(3,) dx, dy, dyaw of a unicycle that goes so far while it turns by so much: Thrun et al., Probabilistic Robotics,
    section 5.3."""
    chord = length_m * float(np.sinc(turn_rad / (2 * np.pi)))
    return np.array([chord * np.cos(turn_rad / 2), chord * np.sin(turn_rad / 2), turn_rad])


def se3(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """4x4 pose from a 3x3 rotation and a (3,) translation."""
    pose = np.zeros((4, 4))
    pose[3, 3] = 1.0
    pose[:3, :3] = rotation
    pose[:3, 3] = translation
    return pose


def rotation_z(yaw_rad: float) -> np.ndarray:
    """3x3 rotation about z."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse of a 4x4 rigid pose; also (N, 4, 4)."""
    if pose.ndim == 2:  # asked a hundred times per view
        turned = pose[:3, :3].T
        return se3(turned, -(turned @ pose[:3, 3]))
    rotation_t = np.swapaxes(pose[..., :3, :3], -1, -2)
    out = np.zeros_like(pose)
    out[..., :3, :3] = rotation_t
    out[..., :3, 3] = -(rotation_t @ pose[..., :3, 3, None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def transform(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N, 3) points moved by a 4x4 pose."""
    moved: np.ndarray = points @ pose[:3, :3].T + pose[:3, 3]
    return moved


def exp_so3(omega: np.ndarray) -> np.ndarray:
    """3x3 rotation of a (3,) rotation vector (Rodrigues)."""
    theta = _length(omega)
    k = hat(omega)
    if theta < 1e-8:
        rotation: np.ndarray = EYE + k + 0.5 * k @ k
    else:
        rotation = EYE + np.sin(theta) / theta * k + (1.0 - np.cos(theta)) / theta**2 * k @ k
    return rotation


def log_so3(rotation: np.ndarray) -> np.ndarray:
    """(3,) rotation vector of a 3x3 rotation, angle in [0, pi]."""
    x, y, z, w = _quaternion(rotation)
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    angle = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)
    squared = angle * angle
    scale = 2.0 + squared / 12.0 + 7.0 * squared * squared / 2880.0 if angle <= 1e-3 else angle / math.sin(angle / 2.0)
    return np.array([scale * x, scale * y, scale * z])


def exp_se3(xi: np.ndarray) -> np.ndarray:
    """4x4 pose of a (6,) twist (translation first, then rotation vector)."""
    rho, omega = xi[:3], xi[3:]
    theta = _length(omega)
    k = hat(omega)
    if theta < 1e-8:
        left = EYE + 0.5 * k + k @ k / 6.0
    else:
        left = EYE + (1 - np.cos(theta)) / theta**2 * k + (theta - np.sin(theta)) / theta**3 * k @ k
    return se3(exp_so3(omega), left @ rho)


def log_se3(pose: np.ndarray) -> np.ndarray:
    """(6,) twist of a 4x4 pose; inverse of exp_se3."""
    omega = log_so3(pose[:3, :3])
    theta = _length(omega)
    k = hat(omega)
    if theta < 1e-8:
        left_inverse = EYE - 0.5 * k + k @ k / 12.0
    else:
        cot = 1.0 / theta**2 - (1.0 + np.cos(theta)) / (2.0 * theta * np.sin(theta)) if theta < np.pi - 1e-6 else (
            1.0 / theta**2)
        left_inverse = EYE - 0.5 * k + cot * k @ k
    return np.concatenate([left_inverse @ pose[:3, 3], omega])


def adjoint(pose: np.ndarray) -> np.ndarray:
    """6x6 adjoint: `pose @ exp(xi) == exp(adjoint(pose) @ xi) @ pose`, translation first."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = rotation
    out[:3, 3:] = hat(translation) @ rotation
    return out


def compose_covariance(covariance_a: np.ndarray, b_from_c: np.ndarray, covariance_b: np.ndarray) -> np.ndarray:
    """Covariance (6x6) of `a_from_b @ b_from_c` from those of its factors, to first order (right perturbations)."""
    move = adjoint(inverse(b_from_c))
    covariance: np.ndarray = move @ covariance_a @ move.T + covariance_b
    return covariance


def orthonormal(pose: np.ndarray) -> np.ndarray:
    """The same 4x4 pose with its rotation projected onto SO(3)."""
    u, _, vt = np.linalg.svd(pose[:3, :3])
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return se3(rotation, pose[:3, 3])


def quaternion_xyzw(rotation: np.ndarray) -> np.ndarray:
    """(4,) unit quaternion x, y, z, w (w last, >= 0) of a 3x3 rotation."""
    xyzw = _quaternion(rotation)
    return np.array([-v for v in xyzw] if _sign(xyzw) < 0.0 else xyzw)


def _sign(xyzw: tuple[float, float, float, float]) -> float:
    """Of w; of the first other number that is not zero where w is."""
    return next((v for v in (xyzw[3], *xyzw[:3]) if v != 0.0), 1.0)


def _quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """x, y, z, w of a 3x3 rotation (Markley, "Unit quaternion from rotation matrix", JGCD 31(2), 2008), as SciPy has it, to
    the last bit and ten times as fast; SciPy itself for a matrix that is a rotation to a few digits only."""
    m = (a, b, c), (d, e, f), (g, h, i) = np.asarray(rotation, float).tolist()
    off = max(abs(a * d + b * e + c * f), abs(a * g + b * h + c * i), abs(d * g + e * h + f * i))
    long = max(abs(a * a + b * b + c * c - 1.0), abs(d * d + e * e + f * f - 1.0), abs(g * g + h * h + i * i - 1.0))
    if not (off < 5e-13 and long < 1e-9 and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0.0):
        from scipy.spatial.transform import Rotation

        x, y, z, w = Rotation.from_matrix(rotation).as_quat().tolist()
        return x, y, z, w
    trace = a + e + i
    k = max(range(4), key=(a, e, i, trace).__getitem__)
    if k == 3:
        q = [h - f, c - g, d - b, 1.0 + trace]
    else:
        n, o = (k + 1) % 3, (k + 2) % 3
        q = [0.0, 0.0, 0.0, m[o][n] - m[n][o]]
        q[k], q[n], q[o] = 1.0 - trace + 2.0 * m[k][k], m[n][k] + m[k][n], m[o][k] + m[k][o]
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm


def rotation_of_quaternion(xyzw: np.ndarray) -> np.ndarray:
    """3x3 rotation of a quaternion x, y, z, w. Raises ValueError for a zero or non-finite quaternion."""
    from scipy.spatial.transform import Rotation

    q = np.asarray(xyzw, float)
    if not np.all(np.isfinite(q)) or np.linalg.norm(q) < 1e-9:
        raise ValueError(f"quaternion {q.tolist()} has no direction; expected a finite, non-zero x, y, z, w")
    rotation: np.ndarray = Rotation.from_quat(q).as_matrix()
    return rotation


def align(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None, *, with_scale: bool = False
) -> tuple[np.ndarray, float]:
    """Rigid motion, or similarity, that best carries (N, 3) `source` onto (N, 3) `target`.

    Weighted Procrustes (Kabsch; Umeyama 1991 for the scale; thesis eqs 3.1-3.7), safe against reflections.
    Returns (target_from_source 4x4 rigid, scale): `target ~ scale * R @ source + t`.
    """
    w = np.ones(len(source)) if weights is None else np.asarray(weights, float)
    w = w / w.sum()
    mean_s, mean_t = w @ source, w @ target
    s, t = source - mean_s, target - mean_t
    u, d, vt = np.linalg.svd((t * w[:, None]).T @ s)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    variance = w @ (s**2).sum(1)
    scale = float((d * sign).sum() / variance) if with_scale and variance > 0 else 1.0
    return se3(rotation, mean_t - scale * rotation @ mean_s), scale


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Shown):
    """Pinhole camera with skew and optional lens distortion (thesis eqs 2.1-2.20).

    width, height in pixels; fx, fy, cx, cy, skew in pixels; body_from_camera 4x4 extrinsics;
    distortion: OpenCV's (k1, k2, p1, p2, k3), with k4, k5, k6 of the rational model or without, or empty.
    The centre of the top-left pixel is (0, 0).
    readout_s: seconds from the first row of an image to the last, of a rolling shutter; 0 for a global one.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0
    distortion: tuple[float, ...] = ()
    body_from_camera: np.ndarray = field(default_factory=lambda: se3(BODY_FROM_OPTICAL, np.zeros(3)))
    readout_s: float = 0.0

    def __eq__(self, other: object) -> bool:
        """Whether all numbers are the same."""
        return self._numbers() == other._numbers() if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._numbers())

    def _numbers(self) -> tuple[object, ...]:
        return (self.width, self.height, self.fx, self.fy, self.cx, self.cy, self.skew, tuple(self.distortion),
                self.readout_s, *np.ravel(self.body_from_camera).tolist())

    @property
    def matrix(self) -> np.ndarray:
        """3x3 intrinsic matrix K (eq. 2.8)."""
        return np.array([[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def height_m(self) -> float:
        """Height of the camera centre above the floor, metres."""
        return float(self.body_from_camera[2, 3])

    def project(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) pixels of (N, 3) points in the camera frame (eq. 2.12); NaN behind the camera."""
        z = points[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = np.where(z > 1e-9, points[:, 0] / z, np.nan)
            y = np.where(z > 1e-9, points[:, 1] / z, np.nan)
        if self.distortion:
            x, y = distorted(x, y, self.distortion)
        return np.stack([self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy], axis=1)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) directions in the camera frame with z = 1 (back-projection, eqs 2.17-2.20) of (N, 2) pixels."""
        y = (pixels[:, 1] - self.cy) / self.fy
        x = (pixels[:, 0] - self.cx - self.skew * y) / self.fx
        if self.distortion:
            x, y = undistorted(x, y, self.distortion)
        return np.stack([x, y, np.ones_like(x)], axis=1)

    def points(self, pixels: np.ndarray, depth_m: np.ndarray) -> np.ndarray:
        """(N, 3) points in the camera frame of (N, 2) pixels at (N,) depths along z (eq. 2.16)."""
        points: np.ndarray = self.rays(pixels) * np.asarray(depth_m)[:, None]
        return points


def camera_from_fov(width: int, height: int, hfov_deg: float, *, height_m: float, forward_m: float = 0.0,
                    pitch_deg: float = 0.0) -> Camera:
    """An upright camera with square pixels looking along the body's x axis from `height_m` above the floor, or `pitch_deg`
    below it."""
    f = 0.5 * width / np.tan(0.5 * np.radians(hfov_deg))
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    down = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    extrinsics = se3(down @ BODY_FROM_OPTICAL, np.array([forward_m, 0.0, height_m]))
    return Camera(width, height, f, f, (width - 1) / 2, (height - 1) / 2, body_from_camera=extrinsics)
