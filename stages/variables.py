"""The glossary that executes: every quantity that flows between stages, named once.

Lengths are px of the scan as photographed (upright after its EXIF orientation) unless the name says otherwise;
images are indexed ``y, x`` and carry their pixel centres as coordinates ``y`` and ``x`` in those px, so that a
scan analysed at reduced resolution keeps its place. Points are given as separate x and y (image frame) or along
``board_axis`` (x right, y down, z into the wood).
"""

from stages.stage import Variable

# --- the photograph as it comes from the file ---------------------------------------------------------------
ENCODED = Variable("encoded", ("y", "x", "channel"), "u", "1", "Pixels as stored, sRGB-encoded, 8 or 16 bit, RGB.")
OPAQUE = Variable("opaque", ("y", "x"), "b", "1", "False where the file's alpha channel says there is nothing.")
DPI_PIXEL_SIZE = Variable(
    "dpi_pixel_size", (), "f", "mm", "Pixel size from the file's resolution tags; NaN if it has none."
)

# --- block: where the photographed faces lie; of a single scan there is one ----------------------------------
FACE_PLANE = Variable(
    "face_plane",
    # Not `board_axis`, which has a fourth, homogeneous element.
    ("face", "plane_vector", "board_xyz"),
    "f",
    "px",
    "Board-frame point of each face's own pixel (0, 0), then what one px to the right and one px down add.",
)
FACE_TOP = Variable(
    "face_top", ("face",), "f", "px", "y in the atlas of each face's own row 0; 0 for the one face of a single scan."
)

# --- scan ---------------------------------------------------------------------------------------------------
RGB = Variable("rgb", ("y", "x", "channel"), "f", "1", "Linear RGB, 0..1, sRGB primaries.")
VALUE = Variable(
    "value",
    ("y", "x"),
    "f",
    "1",
    "What the rings are sought in: HSV value, or 1 less the density of vessels in ring-porous wood.",
)
VESSEL_SCALE = Variable(
    "vessel_scale", (), "iu", "1", "Reduction at which vessels are small spots; 0 where the wood shows none."
)
VALID = Variable("valid", ("y", "x"), "b", "1", "True on wood; false on background, bark, mount and cracks.")
PIXEL_SIZE = Variable("pixel_size", (), "f", "mm", "Size of a scan pixel; NaN when no scale is known.")
REDUCTION = Variable("reduction", (), "iu", "1", "Scan pixels per array element along each axis.")
RING_SCALE = Variable("ring_scale", (), "f", "px", "Characteristic ring width found in the scan, in scan px.")
STRAIGHT_RUN = Variable("straight_run", (), "f", "px", "How far rings may be followed before their bends matter.")
FACE_PITH_X = Variable("face_pith_x", (), "f", "px", "x of the pith seen on an overview of a disc; NaN elsewhere.")
FACE_PITH_Y = Variable("face_pith_y", (), "f", "px", "y of the pith seen on an overview of a disc; NaN elsewhere.")

# --- orientation --------------------------------------------------------------------------------------------
ORIENTATION = Variable(
    "orientation", ("y", "x"), "f", "rad", "Tangent of the ring boundaries, 0..pi, from +x towards +y."
)
COHERENCE = Variable("coherence", ("y", "x"), "f", "1", "How much of the local structure is of one orientation, 0..1.")

# --- curved_gabor -------------------------------------------------------------------------------------------
RESPONSE = Variable(
    "response", ("y", "x"), "c", "1", "Complex curved Gabor response along `normal`, unit gain for a sinusoid."
)
MAGNITUDE = Variable("magnitude", ("y", "x"), "f", "1", "Magnitude of the response.")
PHASE = Variable("phase", ("y", "x"), "f", "rad", "Phase of the response, growing along `normal`, -pi..pi.")
EXPLAINED = Variable(
    "explained", ("y", "x"), "f", "1", "Share of the local variance across the rings that the response explains, 0..1."
)
NORMAL = Variable(
    "normal",
    ("y", "x"),
    "f",
    "rad",
    "Direction across the rings towards the bright side of their abrupt edge, -pi..pi.",
)
ASYMMETRY = Variable(
    "asymmetry", ("y", "x"), "f", "1", "How surely the abrupt edge tells the two directions of `normal` apart, 0..1."
)
FREQUENCY = Variable("frequency", ("y", "x"), "f", "px-1", "Rings per scan px across the rings.")
CURVATURE = Variable("curvature", ("y", "x"), "f", "px-1", "Curvature of the ring boundaries, absolute.")
RING_ORIENTATION = Variable(
    "ring_orientation", ("y", "x"), "f", "rad", "Orientation of the rings refined from the phase, 0..pi."
)

# --- ring_tracing: polylines as a CF contiguous ragged array ------------------------------------------------
RING_X = Variable("ring_x", ("vertex",), "f", "px", "x of the ring boundary vertices, image frame.")
RING_Y = Variable("ring_y", ("vertex",), "f", "px", "y of the ring boundary vertices, image frame.")
VERTEX_CONFIDENCE = Variable("vertex_confidence", ("vertex",), "f", "1", "Confidence of each vertex, 0..1.")
VERTEX_COUNT = Variable("vertex_count", ("ring",), "iu", "1", "Vertices of each polyline, in order.")
RING_INDEX = Variable("ring_index", ("ring",), "iu", "1", "Consecutive index of the ring boundary, growing outwards.")
#: Under this name `ring_tracing` tells how many different boundaries its polylines are.
RING_COUNT_FIGURE = "ring boundaries"
RING_CONFIDENCE = Variable("ring_confidence", ("ring",), "f", "1", "Confidence of each polyline, 0..1.")
RING_GROUP = Variable(
    "ring_group",
    ("ring",),
    "iu",
    "1",
    "Polylines of one group are tied by counting; between groups the index is a guess.",
)
RING_CLOSED = Variable("ring_closed", ("ring",), "b", "1", "True where the polyline returns to its start.")
CORRECTED_LATEWOOD_X = Variable(
    "corrected_latewood_x", ("corrected_latewood",), "f", "px", "x of the latewood onsets that a person gave."
)
CORRECTED_LATEWOOD_Y = Variable(
    "corrected_latewood_y", ("corrected_latewood",), "f", "px", "y of the latewood onsets that a person gave."
)
CORRECTED_ABSENT_X = Variable(
    "corrected_absent_x",
    ("corrected_absent",),
    "f",
    "px",
    "x on the boundary outside of each ring that a person called absent.",
)
CORRECTED_ABSENT_Y = Variable(
    "corrected_absent_y",
    ("corrected_absent",),
    "f",
    "px",
    "y on the boundary outside of each ring that a person called absent.",
)
RING_PHASE = Variable(
    "ring_phase", ("y", "x"), "f", "rad", "Wrapped 2 pi ring age: 0 at the boundaries, growing outwards, -pi..pi."
)
PHASE_CONFIDENCE = Variable("phase_confidence", ("y", "x"), "f", "1", "Confidence of the ring phase, 0..1.")
GROWTH_ANGLE = Variable("growth_angle", ("y", "x"), "f", "rad", "Outward direction of growth, image frame, -pi..pi.")
BRIGHT_OUTWARDS = Variable(
    "bright_outwards", (), "b", "1", "True where the abrupt edge of a ring brightens outwards (conifers)."
)
GRAIN_RATIO = Variable(
    "grain_ratio", (), "f", "1", "Fine texture's slope across over along the rings: above 1 on faces along the stem."
)
GROWTH_SURENESS = Variable(
    "growth_sureness", (), "f", "1", "How sure the outward direction is: 0.5 is a guess, 1 is certain."
)

# --- anomalies ----------------------------------------------------------------------------------------------
ANOMALY = Variable("anomaly", ("y", "x"), "iu", "1", "0 sound wood, 1 knot, 2 crack, 3 stain.")
ANOMALY_KIND = Variable("anomaly_kind", ("spot",), "iu", "1", "Of each connected anomaly: 1 knot, 2 crack, 3 stain.")
ANOMALY_BOX = Variable(
    "anomaly_box", ("spot", "side"), "f", "px", "Left, top, right and bottom pixel centre of each, image frame."
)
ANOMALY_AREA = Variable("anomaly_area", ("spot",), "f", "px2", "Area of each.")

# --- pose ---------------------------------------------------------------------------------------------------
BOARD_TO_TREE = Variable(
    "board_to_tree", ("tree_axis", "board_axis"), "f", "1", "Rigid 4x4 transform, px to px, pith along tree z."
)
RING_AGE_SHIFT = Variable(
    "ring_age_shift",
    ("group",),
    "iu",
    "1",
    "What to add to a group's ring indices to get the ring age of its boundaries.",
)

INNERMOST_AGE = Variable(
    "innermost_age",
    (),
    "iu",
    "1",
    "ring age of the innermost boundary that is believed; lines inside of it are grain, rings there were not seen",
)
RING_AGE_SIGN = Variable(
    "ring_age_sign",
    ("group",),
    "i",
    "1",
    "-1 where a face of a block was numbered inwards: ring age is sign times index plus shift; else 1.",
)
RING_RADIUS = Variable(
    "ring_radius", ("boundary",), "f", "px", "Ideal radius of each ring boundary, increasing; its age is `boundary`."
)
POSE_SPREAD = Variable(
    "pose_spread", ("pose_parameter",), "f", "1", "One standard deviation of each pose parameter (rad, rad, px, px)."
)
POSE_UNDETERMINED = Variable(
    "pose_undetermined",
    ("pose_parameter",),
    "b",
    "1",
    "True for pose parameters that the faces leave open: spread over 1.6 degrees, a ring or 5 % of a distance.",
)
STEM = Variable(
    "stem",
    ("stem_parameter",),
    "f",
    "px-1",
    "Bend of the pith along tree x and y and taper of the rings; zeros for a straight, cylindrical stem.",
)
RING_WIDTH = Variable("ring_width", (), "f", "px", "Mean ring width across the growth layers.")

# --- initial_distortion, phase_polishing --------------------------------------------------------------------
DISPLACEMENT = Variable(
    "displacement", ("radius", "azimuth", "height"), "f", "px", "Radial displacement m_r on a cylindrical grid."
)
AZIMUTH_WRAPS = Variable("azimuth_wraps", (), "b", "1", "True when the grid's azimuth goes all the way round.")
POLISHED_DISPLACEMENT = Variable(
    "polished_displacement", ("radius", "azimuth", "height"), "f", "px", "Radial displacement after polishing."
)
FACE_AGE = Variable("face_age", ("y", "x"), "f", "rings", "Ring age of the fitted model on the face.")
PHASE_RESIDUAL = Variable(
    "phase_residual", ("y", "x"), "f", "rad", "Observed ring phase minus the model's, wrapped to -pi..pi."
)
LOSS = Variable("loss", ("iteration",), "f", "1", "Weighted mean cyclic loss after each iteration.")

# --- color_map ----------------------------------------------------------------------------------------------
COLOR_STRIP = Variable(
    "color_strip", ("strip", "channel"), "f", "1", "Linear RGB over continuous ring age (coordinate `strip`)."
)
LATENESS_STRIP = Variable(
    "lateness_strip", ("strip",), "f", "1", "0 in earlywood to 1 in latewood over continuous ring age."
)
STRIP_SUPPORT = Variable("strip_support", ("strip",), "f", "px", "Face pixels that each strip sample was fitted to.")
FACE_GAIN = Variable(
    "face_gain", ("face", "channel"), "f", "1", "Linear RGB of each face over that of the wood: its light and balance."
)
RENDERED = Variable("rendered", ("y", "x", "channel"), "f", "1", "Linear RGB of the solid texture on the face.")
SAMPLES_PER_RING = Variable("samples_per_ring", (), "iu", "1", "Strip samples for each ring.")

# --- ring_series: paths, crossings, rings and gaps as contiguous ragged arrays ------------------------------
PATH_X = Variable("path_x", ("path_vertex",), "f", "px", "x of the measurement paths' vertices, from the inside out.")
PATH_Y = Variable("path_y", ("path_vertex",), "f", "px", "y of the measurement paths' vertices, from the inside out.")
PATH_COUNT = Variable("path_count", ("series",), "iu", "1", "Vertices of each path.")
SERIES_KIND = Variable(
    "series_kind", ("series",), "iu", "1", "How a path came about: 0 core, 1 radius, 2 line across, 3 given."
)
SERIES_BEARING = Variable(
    "series_bearing", ("series",), "f", "degree", "Direction of a radius, clockwise from up; NaN for other paths."
)
CROSSING_X = Variable("crossing_x", ("crossing",), "f", "px", "x where a path crosses a boundary, from the inside out.")
CROSSING_Y = Variable("crossing_y", ("crossing",), "f", "px", "y where a path crosses a boundary, from the inside out.")
CROSSING_ANGLE = Variable("crossing_angle", ("crossing",), "f", "rad", "Outward normal of the boundary there, -pi..pi.")
CROSSING_INDEX = Variable("crossing_index", ("crossing",), "iu", "1", "Ring index of the boundary crossed.")
CROSSING_GROUP = Variable("crossing_group", ("crossing",), "iu", "1", "Group of the boundary crossed.")
CROSSING_CONFIDENCE = Variable("crossing_confidence", ("crossing",), "f", "1", "Confidence of the boundary, 0..1.")
CROSSING_BESIDE = Variable(
    "crossing_beside", ("crossing",), "b", "1", "True where the boundary was seen beside the path, not on it."
)
CROSSING_PITH = Variable("crossing_pith", ("crossing",), "b", "1", "True where it is the pith and no boundary.")
CROSSING_COUNT = Variable("crossing_count", ("series",), "iu", "1", "Crossings of each path.")
SERIES_RING_INDEX = Variable(
    "series_ring_index", ("series_ring",), "iu", "1", "Index of the boundary that closes the ring outside."
)
SERIES_RING_INNER = Variable(
    "series_ring_inner", ("series_ring",), "i", "1", "Crossing of its path at the ring's inside; -1 if not traced."
)
SERIES_RING_OUTER = Variable(
    "series_ring_outer", ("series_ring",), "i", "1", "Crossing of its path at the ring's outside; -1 if not traced."
)
SERIES_RING_WIDTH = Variable(
    "series_ring_width",
    ("series_ring",),
    "f",
    "px",
    "Ring width at right angles to the boundaries; NaN where one was not traced.",
)
EARLYWOOD_WIDTH = Variable(
    "earlywood_width", ("series_ring",), "f", "px", "Width of the ring's earlywood; NaN where its end was not seen."
)
LATEWOOD_WIDTH = Variable(
    "latewood_width", ("series_ring",), "f", "px", "Width of the ring's latewood; NaN where its onset was not seen."
)
LATEWOOD_ONSET = Variable(
    "latewood_onset", ("series_ring",), "f", "1", "Where in the ring latewood begins, 0..1 outwards; NaN if not seen."
)
ONSET_SURENESS = Variable("onset_sureness", ("series_ring",), "f", "1", "How sure the latewood onset is, 0..1.")
MEASURE_X = Variable(
    "measure_x", ("series_ring", "ring_end"), "f", "px", "x of the ends of the line measured across; NaN if none."
)
MEASURE_Y = Variable(
    "measure_y", ("series_ring", "ring_end"), "f", "px", "y of the ends of the line measured across; NaN if none."
)
LATENESS_TABLE = Variable(
    "lateness_table",
    ("series_ring", "fraction"),
    "f",
    "1",
    "Straightened rings: inverted HSL lightness (HSL lightness in ring-porous wood) over the fraction; NaN if unknown.",
)
SERIES_RING_COUNT = Variable("series_ring_count", ("series",), "iu", "1", "Rings of each series.")
GAP_SERIES = Variable("gap_series", ("gap",), "iu", "1", "Series that a gap belongs to.")
GAP_X = Variable("gap_x", ("gap", "gap_end"), "f", "px", "x of the ends of a part whose rings cannot be counted.")
GAP_Y = Variable("gap_y", ("gap", "gap_end"), "f", "px", "y of the ends of a part whose rings cannot be counted.")
GAP_BOUNDARIES = Variable("gap_boundaries", ("gap",), "iu", "1", "Boundaries beyond the gap, not tied to the series.")
SERIES_UNFIT = Variable(
    "series_unfit", ("series",), "iu", "1", "Boundaries left out because their index contradicts the others'."
)
SERIES_INNER_REST = Variable("series_inner_rest", ("series",), "f", "px", "Wood inside of the first boundary.")
SERIES_OUTER_REST = Variable("series_outer_rest", ("series",), "f", "px", "Wood outside of the last boundary.")
PITH_ON_SAMPLE = Variable("pith_on_sample", ("series",), "b", "1", "True where the path starts at the pith.")
PITH_X = Variable("pith_x", ("series",), "f", "px", "x of the pith; NaN when nothing tells.")
PITH_Y = Variable("pith_y", ("series",), "f", "px", "y of the pith; NaN when nothing tells.")
PITH_DISTANCE = Variable(
    "pith_distance",
    ("series", "estimate"),
    "f",
    "px",
    "Way from the series' inner end to the pith, and one standard deviation less and more; NaN when nothing tells.",
)
PITH_YEARS = Variable("pith_years", ("series",), "i", "1", "Rings between the inner end and the pith; -1 if unknown.")
OUTERMOST_YEAR = Variable(
    "outermost_year",
    (),
    "f",
    "year",
    "Year of the outermost wood; NaN when not given. Its attribute `pattern` finds it in the scan's name.",
)
OUTERMOST_COMPLETE = Variable(
    "outermost_complete", (), "b", "1", "True where the last boundary ends the outermost year's ring."
)
ABSENT_YEARS = Variable("absent_years", ("absent",), "i", "year", "Years whose ring is locally absent.")
SERIES_VARIABLES = (
    PATH_X,
    PATH_Y,
    PATH_COUNT,
    SERIES_KIND,
    SERIES_BEARING,
    CROSSING_X,
    CROSSING_Y,
    CROSSING_ANGLE,
    CROSSING_INDEX,
    CROSSING_GROUP,
    CROSSING_CONFIDENCE,
    CROSSING_BESIDE,
    CROSSING_PITH,
    CROSSING_COUNT,
    SERIES_RING_INDEX,
    SERIES_RING_INNER,
    SERIES_RING_OUTER,
    SERIES_RING_WIDTH,
    EARLYWOOD_WIDTH,
    LATEWOOD_WIDTH,
    LATEWOOD_ONSET,
    ONSET_SURENESS,
    MEASURE_X,
    MEASURE_Y,
    LATENESS_TABLE,
    SERIES_RING_COUNT,
    GAP_SERIES,
    GAP_X,
    GAP_Y,
    GAP_BOUNDARIES,
    SERIES_UNFIT,
    SERIES_INNER_REST,
    SERIES_OUTER_REST,
    PITH_ON_SAMPLE,
    PITH_X,
    PITH_Y,
    PITH_DISTANCE,
    PITH_YEARS,
)

# --- close_up: windows of the photograph at its own resolution -----------------------------------------------
CLOSE_UP = Variable(
    "close_up",
    ("window", "window_row", "window_column", "channel"),
    "u",
    "1",
    "Pixels as stored, sRGB-encoded, of windows of the scan; 0 beyond its edge.",
)
CLOSE_UP_OPAQUE = Variable(
    "close_up_opaque",
    ("window", "window_row", "window_column"),
    "b",
    "1",
    "False where alpha says there is nothing, and beyond the scan's edge.",
)
CLOSE_UP_X = Variable("close_up_x", ("window",), "f", "px", "x of each window's first pixel.")
CLOSE_UP_Y = Variable("close_up_y", ("window",), "f", "px", "y of each window's first pixel.")

# --- fine_grain: lattice noises in the tree -------------------------------------------------------------------
FINE_GRAIN_KIND = Variable(
    "fine_grain_kind", ("noise",), "i", "1", "Of each noise: 0 fibre streaks, 1 pores, 2 rays, 3 streaks in the layers."
)
FINE_GRAIN_CELLS = Variable(
    "fine_grain_cells", ("noise", "cell_axis"), "f", "px", "Size of each lattice's cells: across, across, along."
)
FINE_GRAIN_DENSITY = Variable("fine_grain_density", ("noise",), "f", "1", "Share of the cells that hold a pore.")
FINE_GRAIN_AMPLITUDE = Variable(
    "fine_grain_amplitude", ("noise", "wood_part"), "f", "1", "Exponent of each noise in earlywood and in latewood."
)
FINE_GRAIN_COLOR = Variable(
    "fine_grain_color", ("noise", "channel"), "f", "1", "Share of the exponent that red, green and blue get."
)
FINE_GRAIN_LOG_MEAN = Variable(
    "fine_grain_log_mean", ("lateness_level", "channel"), "f", "1", "Logarithm of the mean factor, taken off again."
)
FINE_GRAIN_SEED = Variable("fine_grain_seed", (), "iu", "1", "Seed of the noises.")
