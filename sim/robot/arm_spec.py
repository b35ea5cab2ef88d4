"""Scene of the laboratory for any arm, as a MuJoCo specification.

Whatever the arm's file calls its parts, the finished scene has one set of names: body `probe` with
the sites `ft` and `tcp` and the geoms `probe_tip` and `tip_contact`, sensors `ft_force`,
`ft_torque` and `touch`, one motor a joint, and table, body and pad.
"""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np

from models import ARM_PACKAGE, Arm, InputError, mesh_folder

PROBE = "probe"
SENSOR_M, ROD_M = 0.03, 0.12
"""Ends of the sensor's housing and of the rod, from the flange, on a probe of 0.145 m."""

STANDARD_M = 0.145
RED, BLUE, GREY = (0.85, 0.3, 0.2, 1.0), (0.2, 0.45, 0.7, 1.0), (0.7, 0.72, 0.75, 1.0)
BODY_PINK = (0.9, 0.6, 0.55, 0.5)


def arm_spec(arm: Arm) -> mujoco.MjSpec:
    """Return the arm with its probe, sensors and motors; no table and no body.

    Raises
    ------
    InputError
        A model that MuJoCo cannot read, or that lacks a part that arm.toml names.
    """
    try:
        text = _urdf(arm) if arm.is_urdf else None
        spec = mujoco.MjSpec.from_string(text) if text else mujoco.MjSpec.from_file(str(arm.model))
    except ValueError as error:
        raise InputError(f"{arm.model}: MuJoCo cannot read it ({error})") from error
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    # Explicit damping: the velocity's difference over a step is the acceleration that the wrist saw
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    if arm.is_urdf:
        _finish_urdf(spec, arm)
    if arm.probe.body:
        _named(spec.body(arm.probe.body), "probe.body", arm.probe.body, arm)
        spec.body(arm.probe.body).name = PROBE
    else:
        _mount_probe(spec, arm)
    have = {joint.name for joint in spec.joints}
    for name in arm.joints:
        if name not in have:
            raise InputError(f"{arm.model}: has no joint '{name}'; arm.toml names it in joints")
    extra = have - set(arm.joints)
    if extra:
        raise InputError(
            f"{arm.model}: has the joints {', '.join(sorted(extra))} beside those of arm.toml; "
            "fix or remove them"
        )
    return spec


def _urdf(arm: Arm) -> str:
    """Return the URDF as MuJoCo reads it: meshes by their path, static links kept."""
    root = ElementTree.parse(arm.model).getroot()
    for mesh in root.iter("mesh"):
        name = str(mesh.get("filename"))
        if name.startswith(ARM_PACKAGE):
            share = mesh_folder("example-robot-data")
            name = str(share / name.removeprefix(ARM_PACKAGE)) if share else name
        elif not name.startswith("/"):
            name = str(arm.model.parent / name)
        mesh.set("filename", name)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            if link.find("collision") is not None:
                link.remove(visual)  # MuJoCo does not read the pictures' formats
    compiler = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    compiler.attrib |= {"fusestatic": "false", "strippath": "false", "discardvisual": "false"}
    return ElementTree.tostring(root, encoding="unicode")


def _finish_urdf(spec: mujoco.MjSpec, arm: Arm) -> None:
    for joint in spec.joints:
        joint.armature, joint.damping = arm.armature_kg_m2, [arm.damping_n_m_s, 0, 0]
        joint.frictionloss = 0.0
    for name in arm.joints:
        motor = spec.add_actuator(name=f"motor_{name}", target=name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    for body in spec.bodies:
        for number, geom in enumerate(body.geoms):
            geom.name = geom.name or f"{body.name}_{number}"
            geom.contype = geom.conaffinity = 0
            geom.rgba = (0.85, 0.86, 0.88, 1.0)


def _named(part: object, key: str, name: str, arm: Arm) -> None:
    if part is None:
        raise InputError(f"{arm.model}: has no body '{name}'; arm.toml names it in {key}")


def _mount_probe(spec: mujoco.MjSpec, arm: Arm) -> None:
    """Add the standard probe with its force sensor at the arm's flange."""
    probe = arm.probe
    flange = spec.body(probe.flange)
    _named(flange, "probe.flange", probe.flange, arm)
    body = flange.add_body(name=PROBE)
    body.mass, body.ipos, body.inertia = probe.mass_kg, probe.centre_m, probe.inertia_kg_m2
    body.explicitinertial = True
    scale = probe.length_m / STANDARD_M
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    for name, start, end, radius, rgba in (
        ("probe_sensor", 0.0, SENSOR_M * scale, 0.0375, BLUE),
        ("probe_rod", SENSOR_M * scale, ROD_M * scale, 0.008, GREY),
        ("probe_tip", ROD_M * scale, probe.length_m, 0.005, RED),
    ):
        body.add_geom(
            name=name, type=cylinder, fromto=[0, 0, start, 0, 0, end], size=[radius, 0, 0],
            rgba=rgba, contype=0, conaffinity=0, mass=0,
        )  # fmt: skip
    body.add_geom(
        name="tip_contact", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.001, 0, 0],
        pos=[0, 0, probe.length_m - 0.001], group=4, contype=0, conaffinity=0, mass=0,
    )  # fmt: skip
    body.add_site(name="ft", pos=[0, 0, 0])
    body.add_site(name="tcp", pos=[0, 0, probe.length_m])
    for name, kind in (("ft_force", "FORCE"), ("ft_torque", "TORQUE")):
        spec.add_sensor(
            name=name, type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objname="ft",
            objtype=mujoco.mjtObj.mjOBJ_SITE,
        )  # fmt: skip


def add_touch_sensor(spec: mujoco.MjSpec) -> None:
    """Add the sensor `touch`: the true force of all contacts of the probe."""
    everywhere = spec.body(PROBE).add_site(name="touch", group=5)
    everywhere.type, everywhere.size = mujoco.mjtGeom.mjGEOM_SPHERE, [1.0, 0, 0]
    spec.add_sensor(
        name="touch", type=mujoco.mjtSensor.mjSENS_TOUCH, objname="touch",
        objtype=mujoco.mjtObj.mjOBJ_SITE,
    )  # fmt: skip


Boxes = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
"""Edges and centre of boxes, (3,) m each."""


def add_obstacles(spec: mujoco.MjSpec, boxes: Boxes) -> None:
    """Add boxes that the arm has to keep clear of."""
    for number, (size, centre) in enumerate(boxes, start=1):
        spec.worldbody.add_geom(
            name=f"obstacle_{number}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre,
            size=np.asarray(size) / 2, contype=0, conaffinity=0, rgba=[0.5, 0.5, 0.55, 1],
        )  # fmt: skip


def add_scene(
    spec: mujoco.MjSpec, body_size_m: np.ndarray, position_m: np.ndarray, quaternion: np.ndarray
) -> None:
    """Add table, body and pad to an arm.

    The body is a box; its mechanics are the finite element model's. The pad is a plane, moved as
    mocap body, that stands for the body's surface under the tip: a plane and not a box, so that a
    soft body may give way by more than any thickness. The tip touches pad and table, nothing else
    touches.

    Parameters
    ----------
    body_size_m : edges of the body's box, from its frame's origin
    position_m, quaternion : pose of the body's frame
    """
    world, box = spec.worldbody, mujoco.mjtGeom.mjGEOM_BOX
    world.add_light(name="lamp", pos=[0.5, -0.5, 1.5], dir=[-0.2, 0.3, -1])
    world.add_geom(
        name="table", type=box, pos=[0.3, 0, -0.02], size=[0.55, 0.45, 0.02], contype=0,
        conaffinity=0, rgba=[0.75, 0.7, 0.62, 1],
    )  # fmt: skip
    half = body_size_m / 2
    body = world.add_body(name="soft_body", pos=position_m, quat=quaternion)
    body.add_geom(
        name="soft_body", type=box, pos=half, size=half, contype=0, conaffinity=0, rgba=BODY_PINK
    )
    pad = world.add_body(name="pad", mocap=True, pos=[0.45, 0, 0.048])
    pad.add_geom(
        name="pad", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.02, 0.02, 0.001], contype=0,
        conaffinity=0, group=4, rgba=[0.9, 0.6, 0.55, 0.3],
    )  # fmt: skip
    stop = spec.add_pair(name="tip_on_table", geomname1="tip_contact", geomname2="table", condim=1)
    stop.solimp, stop.solref = [0.9, 0.9, 0.001, 0.5, 2], [-20000, -200]
    pair = spec.add_pair(name="tip_on_pad", geomname1="tip_contact", geomname2="pad", condim=1)
    pair.solimp, pair.solref = [0.0001, 0.0001, 0.001, 0.5, 2], [-100, 0]
