//! The effects that there are formulas for.

/// An effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Its name; that of `docs/reference/session-files.md` 4.1, or `outside-..` where no library knows it.
    pub name: &'static str,
    /// Its subjects.
    pub subjects: &'static [&'static str],
    /// The formula in words.
    pub formula: &'static str,
}

impl Entry {
    /// No library of causes knows it.
    #[must_use]
    pub fn outside(&self) -> bool {
        self.name.starts_with("outside-")
    }
}

const NONE: &[&str] = &[""];
const AXES: &[&str] = &["x", "y", "z"];
const TABLES: &[&str] = &["a", "c"];

const fn entry_of(name: &'static str, subjects: &'static [&'static str], formula: &'static str) -> Entry {
    Entry { name, subjects, formula }
}

/// All effects.
pub const CATALOGUE: &[Entry] = &[
    entry_of("squareness", &["xy", "yz", "zx"], "the line of motion turned, exactly"),
    entry_of("scale", AXES, "the way times a factor"),
    entry_of("positioning", AXES, "a broken or smooth line through random knots, less its line"),
    entry_of("cyclic", AXES, "a skewed wave: sin(p + 0.5 sin p); metric, inch and module pitches"),
    entry_of("wear", AXES, "a raised cosine"),
    entry_of(
        "straightness",
        &["eyx", "ezx", "exy", "ezy", "exz", "eyz"],
        "sines of random wavelengths above half the travel, or kinks, less their line",
    ),
    entry_of(
        "angular",
        &["eax", "ebx", "ecx", "eay", "eby", "eaz", "ebz"],
        "the carriage turned, exactly, by kinks or a line through knots, zero at home",
    ),
    entry_of(
        "sag",
        &["x", "y"],
        "a ram that droops with the power 2.6 of its reach, and tilts what it carries",
    ),
    entry_of("thermal-expansion", AXES, "the scale follows its sensor in part at once, in part late"),
    entry_of("spindle-growth", NONE, "two lags of the speed to the power 1.25"),
    entry_of("ambient-drift", NONE, "two lags of the hall in one direction"),
    entry_of("backlash", &["x", "y", "z", "a", "c"], "from one stop to the other as tanh of the way"),
    entry_of("lateral-play", AXES, "the same, across the axis"),
    entry_of(
        "reversal-spike",
        AXES,
        "(t/T) exp(1 - t/T) after a reversal, a little larger at higher acceleration",
    ),
    entry_of("servo-mismatch", AXES, "a lag that shrinks with the speed"),
    entry_of("latency", NONE, "a delay of all axes to second order, with jitter"),
    entry_of(
        "clock-skew",
        NONE,
        "another delay of each moving instrument, which grows with the square of time",
    ),
    entry_of("inertial", AXES, "arctan of the acceleration"),
    entry_of("inertial-cross", AXES, "arctan of the acceleration tilts all, or pushes another axis"),
    entry_of("load", AXES, "a contact that stiffens: F / (1 + |F|/F0)^0.3"),
    entry_of("spindle-tilt", NONE, "the tool turned, exactly"),
    entry_of("tool-length", NONE, "the tool longer by a factor"),
    entry_of("dead-path", NONE, "air over range and dead path, a little curved in the temperature"),
    entry_of("tracker-scale", NONE, "a factor along the beam, a little curved in the range"),
    entry_of("rotary-location", TABLES, "rotation about another line, exactly"),
    entry_of(
        "rotary-motion",
        TABLES,
        "exp of a cosine of twice the angle and three lobes, without a first harmonic",
    ),
    entry_of("rotary-eccentricity", TABLES, "a disc read off its centre (atan2), and its ellipse"),
    entry_of("vibration", NONE, "a tone that swells and fades, in one direction"),
    entry_of("outliers", NONE, "rare and log-normal"),
    entry_of("quantisation", NONE, "cut to multiples of a step"),
    entry_of("range-noise", NONE, "angles of the tracker, with the power 1.5 of the range"),
    entry_of("outside-warm-bend", NONE, "z bends with x squared times scale against hall"),
    entry_of("outside-speed-place", NONE, "speed of X times its place"),
    entry_of("outside-volume", NONE, "(x - 300) y^2"),
    entry_of("outside-creep", NONE, "creep after loads: the force of the last minutes"),
    entry_of("outside-ripple", NONE, "a ripple over the plane of X and Y"),
    entry_of("outside-sawtooth", NONE, "a slow sawtooth of something that nobody logs"),
    entry_of("outside-ringing", NONE, "ringing after start and stop"),
    entry_of("outside-gear", NONE, "a wave of x - 1.37 y, as if the two were geared"),
    entry_of("outside-joint", NONE, "a joint that slips by chance from pass to pass, with a lever in x"),
    entry_of("outside-warm-speed", NONE, "speed squared times the warmth of the hall"),
    entry_of("outside-unbalance", NONE, "the table droops with sin 2A cos C"),
    entry_of(
        "outside-spindle-whirl",
        NONE,
        "the spindle whirls at one of its speeds, and not at a higher one",
    ),
    entry_of("outside-stick", NONE, "a staircase of the way since the reversal"),
    entry_of("outside-root", NONE, "the root of |x z|"),
];

/// An effect by name.
#[must_use]
pub fn entry(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|e| e.name == name)
}

/// Effects that the plan can hardly tell apart: they make no pair.
const ALIKE: &[[&str; 2]] = &[
    ["latency", "clock-skew"],
    ["positioning:x", "wear:x"],
    ["positioning:y", "wear:y"],
    ["positioning:z", "wear:z"],
    ["angular:eaz", "straightness:eyz"],
    ["angular:ebz", "straightness:exz"],
    ["sag:x", "straightness:ezx"],
    ["sag:x", "angular:ebx"],
    ["sag:y", "straightness:ezy"],
    ["sag:y", "angular:eay"],
];

/// True where two labels make no pair.
#[must_use]
pub fn alike(first: &str, second: &str) -> bool {
    ALIKE.iter().any(|[a, b]| (*a == first && *b == second) || (*a == second && *b == first))
}
