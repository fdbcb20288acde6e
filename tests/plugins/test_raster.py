"""The rasteriser: its depth against rays cast in float64, its pictures against what was painted, no holes, no lock held."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.geometry import Camera, camera_from_fov, exp_so3, inverse, se2, se3
from rhs.api.records import Twist
from rhs.worlds.world import load_world
from rhs_sources.raster.renderer import Mesh, Renderer
from rhs_sources.raster.textures import pyramids
from rhs_sources.simulator_config import Simulator
from rhs_sources.simulator_mesh import building

CAMERA = camera_from_fov(81, 61, 57.0, height_m=1.2)  # odd: row 30 looks level, column 40 straight ahead
GREY = np.full((8, 8, 3), 128, np.uint8)
WHOLE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HOME, SQUARE = load_world("home"), load_world("square")


def tilted(x, y, yaw, pitch=0.0, roll=0.0):
    """World_from_body of a camera at (x, y) tilted about its lens."""
    lens = np.array([0.0, 0.0, CAMERA.height_m])
    return se2(x, y, yaw) @ se3(exp_so3(np.array([roll, pitch, 0.0])), lens) @ se3(np.eye(3), -lens)


def upright(x_m, y0_m, y1_m, z0_m, z1_m):
    """A quad in the plane x = x_m that looks towards smaller x: y0_m is its left end as seen."""
    return np.array([[x_m, y0_m, z0_m], [x_m, y1_m, z0_m], [x_m, y1_m, z1_m], [x_m, y0_m, z1_m]]), WHOLE


def triangles(mesh: Mesh) -> Mesh:
    """The same with each quad as two triangles."""
    corners = mesh.vertices_m[mesh.faces[:, :4]]
    second = mesh.faces[:, [0, 2, 3, 3, 4]]
    third = mesh.uv[:, 0] + mesh.uv[:, 2] - mesh.uv[:, 1]  # quads here are parallelograms
    np.testing.assert_allclose(corners[:, 0] + corners[:, 2], corners[:, 1] + corners[:, 3], atol=1e-9)
    faces = np.concatenate([mesh.faces, second])
    faces[:, 3] = -1
    return replace(mesh, faces=faces, uv=np.concatenate([mesh.uv, np.stack([mesh.uv[:, 0], mesh.uv[:, 2], third], 1)]))


def ray_cast(mesh: Mesh, camera: Camera, world_from_body, near_m=0.01):
    """Depth (H, W) float64 by intersecting every ray with every triangle that looks at it (Moeller and Trumbore 1997), inf
    where there is none; and where a ray passes an edge so closely that rounding decides."""
    world_from_camera = world_from_body @ camera.body_from_camera
    v, u = np.indices((camera.height, camera.width)).reshape(2, -1)
    rays = np.linalg.solve(camera.matrix, np.stack([u, v, np.ones(len(u))])).T @ world_from_camera[:3, :3].T
    eye, depth, close = world_from_camera[:3, 3], np.full(len(rays), np.inf), np.zeros(len(rays), bool)
    whole = triangles(mesh) if (mesh.faces[:, 3] >= 0).all() else mesh
    inner = np.arange(len(whole.faces)) % len(mesh.faces) if len(whole.faces) > len(mesh.faces) else None
    for number, (a, b, c) in enumerate(whole.vertices_m[whole.faces[:, :3]]):
        normal = np.cross(b - a, c - a)
        slope = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            z = ((a - eye) @ normal) / slope
            at = eye + z[:, None] * rays - a
            along = np.cross(at, c - a) @ normal / (normal @ normal)
            across = np.cross(b - a, at) @ normal / (normal @ normal)
        sides = np.stack([along, across, 1.0 - along - across])
        own = [1] if inner is not None and number < len(mesh.faces) else [0] if inner is not None else []
        facing = (slope < 0) & (z >= near_m)
        hit = facing & (sides.min(axis=0) >= -1e-12)
        edge = np.delete(sides, own, axis=0) if own else sides  # the diagonal of a quad is no edge
        close |= facing & (sides.min(axis=0) > -1e-7) & (np.abs(edge).min(axis=0) < 1e-7)
        depth[hit] = np.minimum(depth[hit], z[hit])
    shape = camera.height, camera.width
    return depth.reshape(shape), close.reshape(shape)


def assert_same_depth(mesh, pose, camera=CAMERA):
    """Every pixel within a millionth of the ray caster's depth, but for those that an edge passes through."""
    drawn = Renderer(camera).render(mesh, pose)[1].astype(float)
    cast, close = ray_cast(mesh, camera, pose)
    drawn[np.isnan(drawn)] = np.inf
    with np.errstate(invalid="ignore"):
        off = np.where(drawn == cast, 0.0, np.abs(drawn - cast) / cast)
    assert close.mean() < 0.02 and not (off[~close] > 1e-6).any(), (np.nanmax(off[~close]), pose)
    return cast


@pytest.fixture(scope="module")
def meshes():
    """World -> (whole faces, faces cut as PyBullet needs them)."""
    from rhs_sources.simulator_bullet_scene import cut

    made = {}
    for world in (HOME, SQUARE):
        whole = list(building(world, 60.0))
        made[world.name] = [Mesh.of_quads(whole), Mesh.of_quads(
            ([piece for quad in quads for piece in cut(*quad)], image) for quads, image in whole)]
    return made


def stands(world, count, tilt):
    """Poses along the survey's route, looking anywhere."""
    rng = np.random.default_rng(3)
    legs = rng.integers(len(world.route_m) - 1, size=count)
    share = rng.random((count, 1))
    places = world.route_m[legs] * (1 - share) + world.route_m[legs + 1] * share + rng.uniform(-0.3, 0.3, (count, 2))
    return [tilted(*place, *angles) for place, *angles in zip(
        places, rng.uniform(-np.pi, np.pi, count), *rng.uniform(-tilt, tilt, (2, count)), strict=True)]


@pytest.mark.parametrize("tilt", [0.0, 0.3], ids=["level", "tilted"])
@pytest.mark.parametrize("cuts", [0, 1], ids=["whole", "cut"])
@pytest.mark.parametrize("world", [HOME, SQUARE], ids=["home", "square"])
def test_depth_is_that_of_rays_cast_in_float64(meshes, world, cuts, tilt):
    for pose in stands(world, 1 if cuts else 6, tilt):
        assert np.isfinite(assert_same_depth(meshes[world.name][cuts], pose)).all()  # the building is closed


def test_triangles_anywhere_also_through_the_plane_of_the_lens():
    rng = np.random.default_rng(0)
    reached = 0
    for _ in range(30):
        corners = rng.normal([1.0, 0.0, 1.2], 1.5, (12, 1, 3)) + rng.normal(0.0, 2.0, (12, 3, 3))
        faces = np.column_stack([np.arange(36).reshape(12, 3), np.full(12, -1), np.zeros(12, int)]).astype(np.int32)
        texels, levels = pyramids([GREY])
        mesh = Mesh(corners.reshape(-1, 3), faces, np.zeros((12, 3, 2)), texels, levels, np.zeros(len(levels), bool))
        cast = assert_same_depth(mesh, tilted(0.0, 0.0, *rng.uniform(-0.5, 0.5, 3)))
        behind = (corners[:, :, 0] < 0).any(axis=1) & (corners[:, :, 0] > 0).any(axis=1)
        reached += behind.any() and np.isfinite(cast).any()
    assert reached > 20


def test_a_wall_five_centimetres_away_is_drawn(meshes):
    mesh = meshes["square"][0]
    for pose in (tilted(10.0, 0.05, -np.pi / 2), tilted(10.0, 0.05, -np.pi / 2, 0.2, 0.1), tilted(19.95, 0.05, -np.pi / 4)):
        assert np.isfinite(assert_same_depth(mesh, pose)).all() and Renderer(CAMERA).render(mesh, pose)[0].mean() < 250
    np.testing.assert_allclose(Renderer(CAMERA).render(mesh, tilted(10.0, 0.05, -np.pi / 2))[1], 0.05, rtol=1e-6)


def test_a_corner_in_the_middle_of_an_edge_leaves_no_hole_where_the_seam_meets_pixel_centres():
    seam = Mesh.of_quads([([upright(3.0, 9.0, -9.0, -9.0, 1.2), upright(3.0, 9.0, 0.123, 1.2, 9.0),
                            upright(3.0, 0.123, -4.7, 1.2, 9.0), upright(3.0, -4.7, -9.0, 1.2, 9.0)], GREY)])
    drawer, empty = Renderer(CAMERA), 0
    for yaw in np.linspace(-0.5, 0.5, 301):  # the seam lies level with the lens, on the middle row of pixels
        empty += np.isnan(drawer.render(seam, tilted(0.0, 0.0, yaw))[1]).sum()
    for roll in np.linspace(-np.pi, np.pi, 301):  # about the optical axis, which the long edge meets
        empty += np.isnan(drawer.render(seam, tilted(0.0, 0.0, 0.0, 0.0, roll))[1]).sum()
    assert empty == 0


def test_a_face_is_seen_from_its_front_alone_and_the_first_of_two_in_one_plane():
    front, back = upright(2.0, 1.0, -1.0, 0.0, 2.4), upright(1.0, -1.0, 1.0, 0.0, 2.4)
    dark, light = np.full((8, 8, 3), 10, np.uint8), np.full((8, 8, 3), 240, np.uint8)
    image, depth = Renderer(CAMERA).render(Mesh.of_quads([([back], light), ([front], dark), ([front], light)]), np.eye(4))
    assert depth[30, 40] == 2.0 and image[30, 40].tolist() == [10, 10, 10]
    assert np.isnan(depth[30, 0]) and image[30, 0].tolist() == [255, 255, 255]  # beside it


@pytest.mark.parametrize("probes", [0, 1, 8])
@pytest.mark.parametrize("yaw", [0.0, 0.9])
def test_each_pixel_wears_what_is_painted_at_the_place_it_sees(probes, yaw):
    """A wall painted with ramps: red grows from left to right, green from the top down, blue is the same everywhere."""
    ramp = np.zeros((256, 1024, 3), np.uint8)
    ramp[..., 0], ramp[..., 1], ramp[..., 2] = np.arange(1024) / 4, np.arange(256)[:, None], 77
    mesh = Mesh.of_quads([([upright(2.0, 8.0, -8.0, 0.0, 2.4)], ramp)])
    pose = tilted(0.0, 0.5, yaw)
    image, depth = Renderer(CAMERA, probes=probes).render(mesh, pose)
    v, u = np.nonzero(np.isfinite(depth))
    points = CAMERA.points(np.stack([u, v], 1).astype(float), depth[v, u].astype(float))
    place = (pose @ CAMERA.body_from_camera @ np.column_stack([points, np.ones(len(u))]).T)[:3].T
    across, down = (8.0 - place[:, 1]) / 16.0, (2.4 - place[:, 2]) / 2.4  # of the wall
    expected = np.stack([256.0 * across, 256.0 * down, np.full(len(u), 77.5)], axis=1) - 0.5
    inside = ((expected > 12) & (expected < 244)).all(axis=1)
    assert inside.sum() > 2000
    assert np.abs(image[v, u][inside] - expected[inside]).max() < (2.5 if probes else 3.0 + 2 * (yaw > 0))


def test_stripes_too_fine_to_be_seen_are_grey_and_flicker_only_unfiltered():
    stripes = np.zeros((512, 512, 3), np.uint8)
    stripes[:, ::2] = 255
    mesh = Mesh.of_quads([([upright(10.0, 4.0, -4.0, -2.8, 5.2)], stripes)])  # four texels a pixel
    filtered, nearest = (Renderer(CAMERA, probes=p).render(mesh, np.eye(4))[0][12:48, 14:66] for p in (8, 0))
    assert np.abs(filtered.astype(int) - 127).max() <= 4 and set(np.unique(nearest)) == {0, 255}


def test_a_pyramid_holds_the_means_and_borders_that_repeat_the_edge():
    image = np.random.default_rng(0).integers(0, 256, (5, 6, 3), dtype=np.uint8)
    texels, levels = pyramids([GREY, image])
    level0, level1 = ((texels[b - w - 3:b - w - 3 + (w + 2) * (h + 2)].view(np.uint8).reshape(h + 2, w + 2, 4)[..., :3])
                      for b, w, h in levels[1, :2])
    np.testing.assert_array_equal(level0, np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge"))
    padded = np.pad(image, ((0, 1), (0, 0), (0, 0)), mode="edge").astype(float)
    means = padded.reshape(3, 2, 3, 2, 3).mean(axis=(1, 3))
    assert np.abs(level1[1:-1, 1:-1] - means).max() <= 0.5
    assert levels[1, :, 1].tolist() == [6, 3, 2, 1, 1, 1, 1, 1] and levels[1, :, 2].tolist() == [5, 3, 2, 1, 1, 1, 1, 1]


def test_two_meshes_added_are_drawn_as_one_of_both():
    parts = list(building(HOME, 60.0))
    pose = stands(HOME, 1, 0.1)[0]
    added = Mesh.of_quads(parts[:7]) + Mesh.of_quads(parts[7:])
    whole, sum_of_both = (Renderer(CAMERA).render(mesh, pose) for mesh in (Mesh.of_quads(parts), added))
    for one, other in zip(whole, sum_of_both, strict=True):
        np.testing.assert_array_equal(one, other)


def test_quads_and_their_triangles_look_the_same(meshes):
    mesh = meshes["home"][0]
    for pose in stands(HOME, 5, 0.2):
        for probes, allowed in ((0, 0.1), (8, 1.0)):  # grey levels in the mean: filters suit runs of pixels of one face
            (image, depth), (other, its_depth) = (Renderer(CAMERA, probes=probes).render(m, pose)
                                                  for m in (mesh, triangles(mesh)))
            np.testing.assert_allclose(depth, its_depth, rtol=1e-6)
            assert np.abs(image.astype(int) - other).mean() < allowed


def looked(folder, renderer, poses, **settings):
    """Images and depths of a simulator set down at these poses."""
    source = Simulator(renderer=renderer, texture_px_per_m=60.0, image_width=160, command_bias_percent=0.0,
                       command_noise_percent=0.0, **settings).build(SourceContext(np.random.default_rng(0), HOME, folder))
    views = []
    for pose in poses:
        source.teleport(pose)
        views.append(source.drive(Twist(0.0, 0.0, 0.0)))
    source.close()
    return np.array([view.image for view in views]).astype(int), np.array([view.depth for view in views])


def test_it_agrees_with_tinyrenderer_below_five_metres(tmp_path):
    """Beyond, TinyRenderer's depth has a grain of z^2 * 6e-7 m."""
    poses = [se2(x, y, yaw) for (x, y), yaw in zip(HOME.route_m[::3], (0.1, 1.3, 2.9, -2.0, -0.7, 0.4), strict=False)]
    images, depths = looked(tmp_path, "raster", poses, sampling="nearest")
    its_images, its_depths = looked(tmp_path, "tinyrenderer", poses)
    assert len(depths) >= 5
    smooth = np.ones(depths.shape, bool)  # off silhouettes: neighbours differ by less than a twentieth
    for axis in (1, 2):
        for shift in (1, -1):
            smooth &= np.abs(np.roll(its_depths, shift, axis) - its_depths) < 0.05 * its_depths
    near = smooth & (its_depths < 5.0)
    assert near.mean() > 0.5 and np.abs(depths - its_depths)[near].max() < 1e-4
    assert (np.abs(images - its_images).max(axis=3) == 0).mean() > 0.98


def test_a_flat_angle_keeps_more_of_a_painting_than_isotropic_filtering(meshes):
    mesh = Mesh.of_quads(building(SQUARE, 100.0))
    pose = se2(3.0, 1.0, 0.0)  # along a corridor
    blurred, kept = (Renderer(CAMERA, probes=p).render(mesh, pose)[0][:, 20:35].astype(float) for p in (1, 8))
    assert np.abs(np.diff(kept, axis=0)).mean() > 1.3 * np.abs(np.diff(blurred, axis=0)).mean()


HASH = """
import hashlib, sys
sys.path.insert(0, {tests!r})
from test_raster import HOME, CAMERA, Mesh, Renderer, building, stands
mesh, digest = Mesh.of_quads(building(HOME, 60.0)), hashlib.sha256()
for probes in (0, 8):
    for pose in stands(HOME, 6, 0.2):
        digest.update(b"".join(part.tobytes() for part in Renderer(CAMERA, probes=probes).render(mesh, pose)))
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_another_process_without_this_machines_vector_units_draws_the_same_bytes(tmp_path, request):
    code = HASH.format(tests=str(request.path.parent))
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path)}
    digests = [subprocess.run([sys.executable, "-c", code], env=os.environ | more, capture_output=True, text=True,
                              check=True).stdout for more in ({}, plain)]
    own = hashlib.sha256()
    mesh = Mesh.of_quads(building(HOME, 60.0))
    for probes in (0, 8):
        for pose in stands(HOME, 6, 0.2):
            own.update(b"".join(part.tobytes() for part in Renderer(CAMERA, probes=probes).render(mesh, pose)))
    assert digests == [own.hexdigest() + "\n"] * 2


def test_two_threads_draw_what_one_draws(meshes):
    mesh, poses = meshes["home"][0], stands(HOME, 20, 0.1)
    alone = [Renderer(CAMERA).render(mesh, pose)[0] for pose in poses]
    drawn: dict[int, list[np.ndarray]] = {0: [], 1: []}

    def draw(number):
        drawer = Renderer(CAMERA)
        drawn[number] = [drawer.render(mesh, pose)[0] for pose in poses]

    threads = [threading.Thread(target=draw, args=(number,)) for number in drawn]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for pictures in drawn.values():
        np.testing.assert_array_equal(pictures, alone)


def test_a_thread_that_wakes_each_millisecond_is_not_late_while_a_view_is_drawn(meshes):
    camera = camera_from_fov(1600, 1200, 57.0, height_m=1.2)
    drawer, pose, late, over = Renderer(camera), stands(HOME, 1, 0.0)[0], [], threading.Event()

    def wake():
        while not over.is_set():
            begin = time.perf_counter()
            time.sleep(1e-3)
            late.append(time.perf_counter() - begin - 1e-3)

    thread, spent = threading.Thread(target=wake), []
    thread.start()
    for _ in range(8):
        begin = time.perf_counter()
        drawer.render(meshes["home"][0], pose)
        spent.append(time.perf_counter() - begin)
    over.set()
    thread.join()
    # were the lock held, it would wake once or twice a view, most of a view late
    assert len(late) > 4 * len(spent) and np.median(late) < 0.1 * np.median(spent)


def test_the_camera_that_is_drawn_for_is_the_one_that_measures():
    """A face's corners are where the camera projects them, skew and all."""
    camera = replace(CAMERA, skew=3.0, fx=90.0, cx=37.5)
    image, depth = Renderer(camera).render(Mesh.of_quads([([upright(2.0, 0.4, -0.3, 1.0, 1.5)], GREY)]), np.eye(4))
    corners = upright(2.0, 0.4, -0.3, 1.0, 1.5)[0]
    at = camera.project((inverse(camera.body_from_camera) @ np.column_stack([corners, np.ones(4)]).T)[:3].T)
    rows, columns = np.nonzero(np.isfinite(depth))
    assert rows.min() == np.ceil(at[:, 1].min()) and rows.max() == np.ceil(at[:, 1].max()) - 1
    middle = (rows.min() + rows.max()) // 2
    ends = [np.interp(middle, at[[3, 0], 1], at[[3, 0], 0]), np.interp(middle, at[[2, 1], 1], at[[2, 1], 0])]
    assert columns[rows == middle].min() == np.ceil(ends[0]) and columns[rows == middle].max() == np.floor(ends[1])
