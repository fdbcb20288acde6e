"""What to do with maps and buildings of forms that are not read: which program makes one of them that is."""

from __future__ import annotations

import warnings
from pathlib import Path

_PLAN = "export it as a .png and write a .yaml beside it with the lines `image:` and `resolution:` (metres a pixel)"
_SAVED = "with its map on /map type: ros2 run nav2_map_server map_saver_cli -f NAME"
_MESH = "export it as .glb, .obj or .dae"
POINTS = "a cloud of points without walls; make a mesh of it (.ply with faces), or a map: octomap_server or pcd2pgm"
ADVICE = {
    ".pbstream": "a state of Cartographer: ros2 run cartographer_ros cartographer_pbstream_to_ros_map -pbstream_filename "
                 "{file} -map_filestem NAME (ROS 1: rosrun)",
    ".posegraph": f"a pose graph of slam_toolbox: {_SAVED}", ".data": f"a pose graph of slam_toolbox? {_SAVED}",
    ".db": "a data base of RTAB-Map: rtabmap-databaseViewer {file}, File, Export 2D grid map; or its cloud as a mesh, .ply",
    ".bt": f"an OctoMap: ros2 run octomap_server octomap_server_node --ros-args -p octomap_path:={{file}}; {_SAVED}",
    ".pcd": POINTS,
    ".ifc": "a building model: IfcConvert {file} NAME.obj (IfcOpenShell), then world=NAME.obj",
    **dict.fromkeys((".las", ".laz", ".e57", ".xyz", ".pts", ".splat"), POINTS),
    **dict.fromkeys((".dxf", ".dwg", ".svg", ".pdf", ".geojson", ".gml", ".osm"), f"a drawing: {_PLAN}"),
    **dict.fromkeys((".blend", ".fbx", ".skp", ".usd", ".usdz", ".3ds", ".3mf", ".x3d"), f"a model: {_MESH}"),
    **dict.fromkeys((".step", ".stp", ".iges", ".igs", ".fcstd", ".rvt", ".usdc"), f"a model: {_MESH}"),
    **dict.fromkeys((".xml", ".mjcf"), f"a model of MuJoCo? {_MESH}, or its floor plan as a map"),
    ".navmesh": "where agents of Habitat may walk: name the scene's .glb beside it",
    ".house": "what rooms a scene of Matterport has: name its mesh beside it (.ply, .glb, .obj)",
    ".zip": "an archive: unpack it first",
    ".json": f"a plan in numbers: draw it, {_PLAN}", ".ttt": f"a scene of CoppeliaSim: {_MESH}",
    ".mtl": "colours of a mesh: name its .obj", ".proto": f"a part of Webots: {_MESH}",
    **dict.fromkeys((".erb", ".em", ".jinja"), "a recipe of a file: expand it first: erb {file} > NAME.world"),
    ".inc": "a part of a Stage world: name the picture in it (bitmap) as a plan",
}
ADVICE[".ot"], ADVICE[".usda"] = ADVICE[".bt"], ADVICE[".usd"]


def advice_for(path: Path) -> str:
    """What makes a building that is read of such a file; empty of an ending that nobody knows."""
    habitat = path.name.endswith((".scene_instance.json", ".scene_dataset_config.json", ".stage_config.json"))
    said = "a scene of Habitat: name its stage's mesh, world=NAME.glb" if habitat else ADVICE.get(path.suffix.lower(), "")
    return said.format(file=path.name)


def stage_advice(path: Path) -> str:
    """Goes in a later version: worlds of Stage are read (rhs.worlds.others.stage). Empty."""
    warnings.warn(f"stage_advice({path.name}) says nothing any more: worlds of Stage are read; it goes in a later version",
                  FutureWarning, stacklevel=2)
    return ""
