"""The stages, in the order of the data. Adding one is adding it to this tuple."""

from stages.anomalies import anomalies
from stages.close_up import close_up
from stages.color_map import color_map
from stages.curved_gabor import curved_gabor
from stages.fine_grain import fine_grain
from stages.initial_distortion import initial_distortion
from stages.orientation import orientation
from stages.phase_polishing import phase_polishing
from stages.pose import pose
from stages.ring_series import ring_series
from stages.ring_tracing import ring_tracing
from stages.scan import scan
from stages.stage import Stage

STAGES: tuple[Stage, ...] = (
    scan,
    orientation,
    curved_gabor,
    ring_tracing,
    ring_series,
    anomalies,
    close_up,
    pose,
    initial_distortion,
    phase_polishing,
    color_map,
    fine_grain,
)
