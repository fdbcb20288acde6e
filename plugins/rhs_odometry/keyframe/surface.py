"""What a depth image says of the surface under a pixel: its inverse depth there, and how that changes across the image.

On a plane inverse depth is linear in the pixel, so a plane is fitted to the inverse depths of a window; averaging makes
the depth several times surer than one reading, and the slope tells how a patch of the surface is foreshortened.
"""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled

from ..advanced import SurfaceSettings

USUAL = SurfaceSettings()
STEP_PX = 4.0  # from a point to those beside it that say how its surface is foreshortened
ENDS_PX = STEP_PX * np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
SIGNED_PX = STEP_PX * np.array([-1.0, -1.0, 1.0, 1.0])


def surfaces(depth: np.ndarray, pixels: np.ndarray, s: SurfaceSettings = USUAL) -> tuple[np.ndarray, np.ndarray]:
    """Inverse depth (N,) in 1/m at sub-pixel positions (N, 2) of an (H, W) depth image in metres, and its slope (N, 2)
    in 1/m per pixel along u and v. NaN where too little is known, outside, or over an edge."""
    out = np.full((len(pixels), 3), np.nan)
    _fit(depth, np.ascontiguousarray(pixels, np.float64), s.half_px, s.least_known, s.rough_per_m, out)
    return out[:, 0], out[:, 1:]


def rays_beside(pixels: np.ndarray, camera) -> np.ndarray:
    """(N, 4, 3) rays of the pixels beside pixels (N, 2) that `warps` asks for."""
    moved = pixels.astype(float) + ENDS_PX[:, None]  # (4, N, 2)
    return camera.rays(moved.reshape(-1, 2)).reshape(4, -1, 3).transpose(1, 0, 2)


def warps(
    rays: np.ndarray, inverse_depth: np.ndarray, slopes: np.ndarray, *, now_from_then: np.ndarray, camera
) -> np.ndarray:
    """(N, 2, 2) d pixel then / d pixel now of surfaces seen along rays (N, 4, 3) (rays_beside) with inverse depths (N,) and
    slopes (N, 2) at their middle, when the camera has moved: now_from_then (4, 4), or (N, 4, 4) from as many views. NaN
    where it is seen edge on."""
    rotation, centre = now_from_then[..., :3, :3], now_from_then[..., :3, 3]
    along = np.concatenate([slopes.T, slopes.T])
    rho = np.maximum(inverse_depth + SIGNED_PX[:, None] * along, 1e-3)
    local = np.ascontiguousarray(rays.transpose(1, 0, 2)) / rho[..., None]
    ends = camera.project(((rotation @ local[..., None])[..., 0] + centre).reshape(-1, 3)).reshape(2, 2, -1, 2)
    out = np.ascontiguousarray(((ends[1] - ends[0]) / (2.0 * STEP_PX)).transpose(1, 2, 0))
    good = np.abs(np.linalg.det(np.nan_to_num(out))) > 1e-3
    out[~good] = np.nan
    out[good] = np.linalg.inv(out[good])
    return out


@compiled
def _fit(depth, pixels, half, least_known, rough, out):
    height, width = depth.shape
    least = max(least_known * (2 * half + 1) ** 2, 4.0)
    for i in range(pixels.shape[0]):
        if not (np.isfinite(pixels[i, 0]) and np.isfinite(pixels[i, 1])):
            continue
        u, v = int(np.rint(pixels[i, 0])), int(np.rint(pixels[i, 1]))
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        n = su = sv = suu = suv = svv = sr = sur = svr = srr = 0.0
        for y in range(max(v - half, 0), min(v + half + 1, height)):
            for x in range(max(u - half, 0), min(u + half + 1, width)):
                z = depth[y, x]
                if not (z > 0.0 and z < 1e3):  # false for NaN
                    continue
                r, du, dv = 1.0 / z, x - pixels[i, 0], y - pixels[i, 1]
                n += 1.0
                su += du
                sv += dv
                suu += du * du
                suv += du * dv
                svv += dv * dv
                sr += r
                sur += du * r
                svr += dv * r
                srr += r * r
        if n < least:
            continue
        # the plane through them by cofactors of the symmetric normal matrix
        a, b, c = suu * svv - suv * suv, sv * suv - su * svv, su * suv - sv * suu
        determinant = n * a + su * b + sv * c
        if determinant < 1e-6 * n**3:
            continue
        d, e, f = n * svv - sv * sv, su * sv - n * suv, n * suu - su * su
        rho = (a * sr + b * sur + c * svr) / determinant
        along_u = (b * sr + d * sur + e * svr) / determinant
        along_v = (c * sr + e * sur + f * svr) / determinant
        off = max(srr - (rho * sr + along_u * sur + along_v * svr), 0.0)
        if rho > 1e-3 and off < (n - 3.0) * rough**2:
            out[i, 0], out[i, 1], out[i, 2] = rho, along_u, along_v


@compiled
def placed(rays, rho, anchor, ids, poses):
    """(N, 3) points `ids` where poses (K, 4, 4) of their anchors put them: on rays (M, 3) at inverse depths rho (M,)."""
    out = np.empty((len(ids), 3))
    for row in range(len(ids)):
        i = ids[row]
        pose, z = poses[anchor[i]], 1.0 / rho[i]
        x, y, w = rays[i, 0] * z, rays[i, 1] * z, rays[i, 2] * z
        for k in range(3):
            out[row, k] = pose[k, 0] * x + pose[k, 1] * y + pose[k, 2] * w + pose[k, 3]
    return out
