"""List the vocabulary of SDFormat 1.3 to 1.12: elements and attributes read, counted as omitted, or ignored."""

from .xml_elements import Vocabulary, words

VERSIONS = tuple(f"1.{k}" for k in range(3, 13))
IN_MODEL = VERSIONS[:2]  # versions in which axes are given in the model's frame, later in the joint's
IN_PHYSICS = VERSIONS[:3]  # versions in which gravity is a child of physics, later of the world
# attributes of a pose
POSE = words("relative_to degrees rotation_format frame")

VOCABULARY = Vocabulary(
    children={
        "sdf": words("world model"),
        "world": words("model gravity physics"),
        "world physics": words("gravity max_step_size"),
        "model": words("link joint frame pose static"),
        "frame": words("pose"),
        "link": words("pose inertial kinematic gravity"),
        "inertial": words("pose mass inertia"),
        "inertia": words("ixx ixy ixz iyy iyz izz"),
        "joint": words("parent child pose axis axis2"),
        "axis": words("xyz dynamics limit use_parent_model_frame"),
        "axis2": words("xyz dynamics limit use_parent_model_frame"),
        "dynamics": words("damping friction spring_reference spring_stiffness"),
        "limit": words("lower upper effort velocity stiffness dissipation"),
    },
    attributes={
        "sdf": words("version"),
        "world": words("name"),
        "world physics": words("name default type"),
        "model": words("name canonical_link placement_frame"),
        "link": words("name"),
        "joint": words("name type"),
        "frame": words("name attached_to"),
        "pose": POSE,
        "xyz": words("expressed_in"),
        "inertial": words("auto"),
    },
    named={
        "plugin": "plugins",
        "collision": "collision shapes",
        "state": "states",
        "velocity_decay": "velocity decays",
        "gripper": "grippers",
        "sensor": "sensors",
        "physics": "solver settings of joints",
        "actor": "actors",
    },
    ignored=words(  # elements of worlds, models and links; then of physics, where steps of other engines are not used
        "light scene gui magnetic_field atmosphere spherical_coordinates wind audio road visual self_collide "
        "allow_auto_disable enable_wind must_be_base_link projector battery audio_sink audio_source particle_emitter "
        "real_time_factor real_time_update_rate max_contacts ode bullet simbody dart"
    ),
)
