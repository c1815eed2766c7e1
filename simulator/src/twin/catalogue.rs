//! What the twin has physics for.

/// Which subjects an effect may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subjects {
    /// None.
    None,
    /// X, Y, Z.
    Linear,
    /// The ram.
    Ram,
    /// The table.
    Table,
    /// Pairs of axes.
    Pairs,
    /// Straightness of one axis in another direction.
    Straightness,
    /// Angular error motions.
    Angular,
}

impl Subjects {
    /// All of them.
    #[must_use]
    pub const fn list(self) -> &'static [&'static str] {
        match self {
            Self::None => &[""],
            Self::Linear => &["x", "y", "z"],
            Self::Ram => &["y"],
            Self::Table => &["c"],
            Self::Pairs => &["xy", "yz", "zx"],
            Self::Straightness => &["eyx", "ezx", "exy", "ezy", "exz", "eyz"],
            Self::Angular => &["eax", "ebx", "ecx", "eay", "eby", "ecy", "eaz", "ebz"],
        }
    }
}

/// An effect of the twin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Its name; those of the diagnosis where it knows the effect.
    pub name: &'static str,
    /// Its subjects.
    pub subjects: Subjects,
    /// Its constants, besides the size.
    pub constants: &'static [&'static str],
    /// No library of causes knows it.
    pub outside: bool,
    /// What happens.
    pub physics: &'static str,
}

const fn known(
    name: &'static str,
    subjects: Subjects,
    constants: &'static [&'static str],
    physics: &'static str,
) -> Entry {
    Entry { name, subjects, constants, outside: false, physics }
}

const fn outside(name: &'static str, physics: &'static str) -> Entry {
    Entry { name, subjects: Subjects::None, constants: &[], outside: true, physics }
}

/// All effects.
pub const CATALOGUE: &[Entry] = &[
    known(
        "squareness",
        Subjects::Pairs,
        &[],
        "two lines of motion are not at right angles; exact rotation of a line",
    ),
    known("scale", Subjects::Linear, &[], "the grating has another pitch than it should"),
    known(
        "positioning",
        Subjects::Linear,
        &["length-mm"],
        "the thread's lead errs and its errors add up along the screw",
    ),
    known("cyclic", Subjects::Linear, &["pitch-mm", "second"], "the screw wobbles: once and twice per turn"),
    known(
        "wear",
        Subjects::Linear,
        &["centre-mm", "half-mm"],
        "the nut sinks into a worn stretch of the screw",
    ),
    known(
        "straightness",
        Subjects::Straightness,
        &["length-mm"],
        "the guideway is ground with a bend that wanders",
    ),
    known(
        "angular",
        Subjects::Angular,
        &["length-mm"],
        "the guideway is twisted; the carriage follows and turns all it carries",
    ),
    known(
        "sag",
        Subjects::Ram,
        &["tip-share"],
        "the ram bends under its own weight and its head's as it moves out (beam, integrated)",
    ),
    known(
        "thermal-expansion",
        Subjects::Linear,
        &[],
        "a scale warms up with its drive and the hall and grows",
    ),
    known(
        "spindle-growth",
        Subjects::None,
        &["bearing-s", "head-s", "y-share"],
        "bearing and head warm up one behind the other",
    ),
    known(
        "ambient-drift",
        Subjects::None,
        &["column-s"],
        "the column follows the hall's temperature slowly and bends",
    ),
    known(
        "backlash",
        Subjects::Linear,
        &["length-mm", "play-share"],
        "the screw winds up against the table's friction before it moves (Dahl), and play",
    ),
    known(
        "lateral-play",
        Subjects::Linear,
        &["length-mm", "both"],
        "the carriage is pushed aside when the friction turns (Dahl)",
    ),
    known(
        "reversal-spike",
        Subjects::Linear,
        &["integral-per-s", "presliding-mm"],
        "friction turns and the servo's integral needs its time (PI servo, Dahl friction, integrated)",
    ),
    known("servo-mismatch", Subjects::Linear, &[], "too little feedforward of speed: the servo lags behind"),
    known("latency", Subjects::None, &[], "the control sends its set points late to all axes"),
    known("clock-skew", Subjects::None, &["rate"], "the instruments' clocks are off and drift"),
    known(
        "inertial",
        Subjects::Linear,
        &["damping"],
        "the structure is a spring and a mass behind the drive (oscillator, integrated)",
    ),
    known(
        "inertial-cross",
        Subjects::Linear,
        &["damping"],
        "acceleration tilts the structure, which turns what it carries (oscillator, integrated)",
    ),
    known(
        "load",
        Subjects::Linear,
        &["hardening"],
        "a force pushes against contacts that stiffen (solved by Newton)",
    ),
    known("spindle-tilt", Subjects::None, &[], "the spindle leans: a longer tool is further off"),
    known("tool-length", Subjects::None, &[], "the presetter measures tools with a wrong scale"),
    known("dead-path", Subjects::None, &[], "light through air whose refraction nobody corrects"),
    known("tracker-scale", Subjects::None, &[], "the tracker's lengths have a wrong scale"),
    known("rotary-location", Subjects::Table, &[], "the table's axis stands elsewhere and leans"),
    known(
        "rotary-motion",
        Subjects::Table,
        &[],
        "the table wobbles in its bearing, twice and three times per turn",
    ),
    known("rotary-eccentricity", Subjects::Table, &[], "the grating disc sits off its centre"),
    known("vibration", Subjects::None, &["hertz"], "a pump shakes the machine; its phase wanders"),
    known("outliers", Subjects::None, &["share"], "single readings are far off"),
    known("quantisation", Subjects::None, &[], "the display has few digits"),
    known("range-noise", Subjects::None, &[], "the tracker's angles are noisy: more so at a distance"),
    outside(
        "outside-bimetal",
        "a guideway bends with the difference between scale and hall: x squared times a temperature",
    ),
    outside("outside-mass", "the moving table loads the bed: z sinks with x times y squared"),
    outside("outside-film", "oil lifts the carriage the faster it moves, and saturates"),
    outside("outside-volume", "a field over the volume that is no sum of functions of single axes"),
    outside("outside-coolant", "the coolant switches on and off by a thermostat that nobody logs"),
];

/// An effect by name.
#[must_use]
pub fn entry(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|e| e.name == name)
}
