"""Models with random numbers."""

from __future__ import annotations

from hypothesis import strategies as st

from whiptool.models import (
    ArmLink,
    ArmParameters,
    Model,
    WhipParameters,
)

finite = st.floats(1e-4, 10)


@st.composite
def models(draw):
    N = draw(st.integers(1, 5))
    per_node, bent = (
        st.one_of(kind, st.lists(kind, min_size=N, max_size=N).map(tuple)) for kind in (finite, st.floats(-1, 1))
    )
    whip = WhipParameters(
        N=N, l=draw(per_node), m=draw(per_node), k=draw(per_node), b=draw(per_node), drag=draw(per_node),
        rest_angle=draw(bent), dry_friction=draw(per_node), hinge_mass=draw(st.floats(0, 1)),
        friction_velocity=draw(finite), cubic_stiffness=draw(per_node), drag_ratio=draw(st.floats(0, 2)),
        node_inertia=draw(per_node),
    )  # fmt: skip
    links = draw(st.lists(st.builds(ArmLink, finite, finite, finite, finite, finite), min_size=1, max_size=4))
    return Model(whip=whip, arm=ArmParameters(tuple(links)), gravity=draw(st.floats(0, 20)), name="drawn")
