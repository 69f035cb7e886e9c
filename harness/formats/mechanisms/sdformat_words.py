"""List the vocabulary of SDFormat 1.3 to 1.12: elements and attributes read, counted as omitted, or ignored."""

from .xml_elements import Vocabulary, split_words

VERSIONS = tuple(f"1.{k}" for k in range(3, 13))
IN_MODEL = VERSIONS[:2]  # versions in which axes are given in the model's frame, later in the joint's
IN_PHYSICS = VERSIONS[:3]  # versions in which gravity is a child of physics, later of the world
# attributes of a pose
POSE = split_words("relative_to degrees rotation_format frame")

VOCABULARY = Vocabulary(
    children={
        "sdf": split_words("world model"),
        "world": split_words("model gravity physics"),
        "world physics": split_words("gravity max_step_size"),
        "model": split_words("link joint frame pose static"),
        "frame": split_words("pose"),
        "link": split_words("pose inertial kinematic gravity"),
        "inertial": split_words("pose mass inertia"),
        "inertia": split_words("ixx ixy ixz iyy iyz izz"),
        "joint": split_words("parent child pose axis axis2"),
        "axis": split_words("xyz dynamics limit use_parent_model_frame"),
        "axis2": split_words("xyz dynamics limit use_parent_model_frame"),
        "dynamics": split_words("damping friction spring_reference spring_stiffness"),
        "limit": split_words("lower upper effort velocity stiffness dissipation"),
    },
    attributes={
        "sdf": split_words("version"),
        "world": split_words("name"),
        "world physics": split_words("name default type"),
        "model": split_words("name canonical_link placement_frame"),
        "link": split_words("name"),
        "joint": split_words("name type"),
        "frame": split_words("name attached_to"),
        "pose": POSE,
        "xyz": split_words("expressed_in"),
        "inertial": split_words("auto"),
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
    ignored=split_words(  # elements of worlds, models and links; then of physics: steps of other engines are not used
        "light scene gui magnetic_field atmosphere spherical_coordinates wind audio road visual self_collide "
        "allow_auto_disable enable_wind must_be_base_link projector battery audio_sink audio_source particle_emitter "
        "real_time_factor real_time_update_rate max_contacts ode bullet simbody dart"
    ),
)
