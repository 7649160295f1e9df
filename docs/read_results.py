"""Reads a recording with results with the public readers and checks every topic in it.

    pip install mcap mcap-protobuf-support foxglove-schemas-protobuf
    radar-chaperone replay walk.mcap --results results.mcap
    python docs/read_results.py results.mcap

Prints a table of the topics; ends with an error at the first difference from docs/results-format.md. After
`pip install rerun-sdk`, `--rerun` also reads the file with Rerun and checks which component it makes of each topic.
"""

import argparse
import math
import struct
import sys
from collections import Counter, defaultdict

# The published schemas: messages read with the schema in the file must agree with these.
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

SCHEMAS = {
    "/radar/frame": "radar_chaperone.Frame",
    "/tracking/head_raw": "radar_chaperone.TrackedPose",
    "/tracking/head": "foxglove.FrameTransform",
    "/tracking/mount": "foxglove.FrameTransform",
    "/room": "foxglove.FrameTransform",
    "/beam": "foxglove.SceneUpdate",
    "/beam/outline": "foxglove.PointCloud",
    "/scene": "foxglove.SceneUpdate",
    "/scene/points": "foxglove.PointCloud",
    "/scene/outlines": "foxglove.PointCloud",
    "/evidence": "foxglove.PointCloud",
    "/figures": "radar_chaperone.results.Figures",
    "/log": "foxglove.Log",
}
PUBLISHED = {
    "foxglove.FrameTransform": FrameTransform,
    "foxglove.Log": Log,
    "foxglove.PointCloud": PointCloud,
    "foxglove.SceneUpdate": SceneUpdate,
}
# The component that Rerun 0.41 makes of each topic; `message` where it only lists the message.
RERUN = {
    "/tracking/head": "Transform3D:translation",
    "/tracking/mount": "Transform3D:translation",
    "/room": "Transform3D:translation",
    "/beam/outline": "Points3D:positions",
    "/scene/points": "Points3D:positions",
    "/scene/outlines": "Points3D:positions",
    "/evidence": "Points3D:positions",
    "/log": "TextLog:text",
    "/figures": "radar_chaperone.results.Figures:message",
    "/beam": "foxglove.SceneUpdate:message",
    "/scene": "foxglove.SceneUpdate:message",
}
MAX_POINTS = {"/evidence": 2000, "/scene/points": 6000, "/scene/outlines": 12000, "/beam/outline": 12000}
FRAMES = {"/beam/outline": "sensor", "/beam": "sensor"}


def check(holds, *details):
    if not holds:
        sys.exit("WRONG: " + " ".join(str(part) for part in details))


def check_rotation(q, *details):
    check(abs(math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2) - 1) < 1e-9, *details, "quaternion", q)


def check_finite(v, *details):
    check(all(math.isfinite(c) for c in (v.x, v.y, v.z)), *details, "not finite", v)


def check_transform(topic, t, frames):
    check_rotation(t.rotation, topic)
    check_finite(t.translation, topic)
    parent = frames.setdefault(t.child_frame_id, t.parent_frame_id)
    check(parent == t.parent_frame_id, topic, "two parents of", t.child_frame_id)


def check_cloud(topic, cloud):
    check(cloud.frame_id == FRAMES.get(topic, "tracking"), topic, "frame", cloud.frame_id)
    names = [field.name for field in cloud.fields]
    check(names == ["x", "y", "z", "value", "red", "green", "blue", "alpha"], topic, "fields", names)
    count, rest = divmod(len(cloud.data), cloud.point_stride)
    check(rest == 0 and count <= MAX_POINTS[topic], topic, "holds", count, "points and", rest, "bytes")
    for x, y, z, value, *_ in struct.iter_unpack("<4f4B", cloud.data):
        check(all(map(math.isfinite, (x, y, z, value))), topic, "not finite", x, y, z, value)
        check(max(map(abs, (x, y, z))) < 100, topic, "beyond 100 m", x, y, z)
    return count


def check_scene(topic, update, present):
    """Applies an update to the names of the entities in the scene."""
    for deletion in update.deletions:
        check(deletion.type == SceneEntityDeletion.MATCHING_ID, topic, "deletes all")
        check(deletion.id in present, topic, "deletes an entity that does not exist:", deletion.id)
        present.discard(deletion.id)
    names = [entity.id for entity in update.entities]
    check(len(names) == len(set(names)), topic, "has two entities of the same name")
    present.update(names)
    check(present == set(names), topic, "not deleted:", present - set(names))
    for entity in update.entities:
        check(entity.frame_id == FRAMES.get(topic, "tracking"), topic, "frame", entity.frame_id)
        for shape in [*entity.cubes, *entity.spheres]:
            check_rotation(shape.pose.orientation, topic, entity.id)
            check_finite(shape.pose.position, topic, entity.id)
            check(min(shape.size.x, shape.size.y, shape.size.z) > 0, topic, entity.id, "has no size")
        for point in [p for part in [*entity.lines, *entity.triangles] for p in part.points]:
            check_finite(point, topic, entity.id)
        check(all(len(part.points) % 3 == 0 for part in entity.triangles), topic, entity.id, "has an incomplete triangle")
        if entity.id.startswith("obstacle "):
            check(len(entity.spheres) == 1 and len(entity.texts) == 1, topic, entity.id, "has no label")
            check(entity.texts[0].text.startswith("#" + entity.id.split()[1]), topic, entity.texts[0].text)


def check_figures(figures, scene_names):
    kinds = Counter(name.split()[0] for name in scene_names)
    check(figures.obstacles == kinds["obstacle"], "/figures", figures.obstacles, "obstacles; in the scene", kinds)
    check(figures.walls == kinds["wall"], "/figures", figures.walls, "walls; in the scene", kinds)
    known = [d for d in (figures.nearest_obstacle_m, figures.nearest_wall_m) if not math.isnan(d)]
    check(not known or figures.nearest_m == min(known), "/figures nearest", figures)
    check(all(0 <= d < 20 for d in known), "/figures distances", known)
    check(math.isnan(figures.evidence_age_ms) or -50 < figures.evidence_age_ms < 5000, "/figures age", figures)
    for name in ("frames_per_s", "sweeps_per_s", "poses_per_s"):
        rate = getattr(figures, name)
        check(math.isnan(rate) or 0 <= rate < 1e5, "/figures", name, rate)


def read(path):
    counts, sizes, last = Counter(), Counter(), defaultdict(int)
    frames, present, beam, found, points = {}, set(), set(), set(), Counter()
    with open(path, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        schemas = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
        for topic, name in schemas.items():
            check(SCHEMAS.get(topic, name) == name, topic, "has the schema", name)
        for missing in set(SCHEMAS) - set(schemas) - {"/log"}:
            check(False, "no topic", missing)
        # In the order of the file, which must be the order of time.
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            topic = channel.topic
            check(message.log_time >= last[topic], topic, "goes back in time at", message.log_time)
            last[topic] = message.log_time
            counts[topic] += 1
            sizes[topic] += len(message.data)
            if schema.name in PUBLISHED:
                again = PUBLISHED[schema.name].FromString(message.data)
                check(again.SerializeToString(deterministic=True) == decoded.SerializeToString(deterministic=True),
                      topic, "differs when read with the published schema")
                decoded = again
            if schema.name == "foxglove.FrameTransform":
                check_transform(topic, decoded, frames)
            elif schema.name == "foxglove.PointCloud" and topic in MAX_POINTS:
                points[topic] += check_cloud(topic, decoded)
            elif topic == "/beam":
                check_scene(topic, decoded, beam)
            elif topic == "/scene":
                check_scene(topic, decoded, present)
                found |= present
            elif topic == "/figures":
                check_figures(decoded, present)
            elif topic == "/log":
                words = decoded.message.split()
                if words[2:3] == ["found"]:
                    check(" ".join(words[:2]) in found, "/log", decoded.message)
    for child, parent in {"tracking": "room", "head": "tracking", "sensor": "head"}.items():
        check(frames.get(child) == parent, "frames", frames)
    for topic in ("/room", "/beam", "/beam/outline", "/tracking/mount"):
        check(counts[topic] == 1, topic, counts[topic], "messages instead of 1")
    check(counts["/scene"] == counts["/figures"] > 0, "numbers of updates", counts)
    return schemas, counts, sizes, points


def check_rerun(path):
    """Reads with Rerun and checks the components that it made."""
    from rerun.chunk import McapReader

    schema = McapReader(path).stream().collect().schema()
    components = {(column.entity_path, column.component) for column in schema.component_columns()}
    for topic, component in RERUN.items():
        check((topic, component) in components, "Rerun does not make", component, "of", topic)
        print(f"Rerun: {topic:18} {component}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("file")
    arguments.add_argument("--rerun", action="store_true", help="also check the components that Rerun makes")
    arguments = arguments.parse_args()
    schemas, counts, sizes, points = read(arguments.file)
    print(f"{'topic':20} {'schema':34} {'messages':>8} {'bytes':>10} {'points':>8}")
    for topic in sorted(schemas):
        print(f"{topic:20} {schemas[topic]:34} {counts[topic]:8} {sizes[topic]:10} {points[topic] or '':>8}")
    if arguments.rerun:
        check_rerun(arguments.file)
    print("no differences")


main()
