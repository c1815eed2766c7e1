//! The sign table of a 6D instrument, `volcomp-6d/1` (TOML), and its tilt test (CSV).

use crate::identify::prelude::*;
use volcomp_identify::straightness::signs::{
    Assignment, Channel, SignTable, TiltFound, TiltReading, tilt_test,
};

/// The `format` of a sign table.
const FORMAT: &str = "volcomp-6d/1";

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct FileWire {
    format: String,
    instrument: Option<String>,
    x: Option<SetUpWire>,
    y: Option<SetUpWire>,
    z: Option<SetUpWire>,
    u: Option<SetUpWire>,
    v: Option<SetUpWire>,
    w: Option<SetUpWire>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct SetUpWire {
    distance: Option<String>,
    horizontal: Option<String>,
    vertical: Option<String>,
    roll: Option<String>,
    pitch: Option<String>,
    yaw: Option<String>,
    tilt_test: Option<String>,
}

/// One set-up of the instrument.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SetUp {
    pub(super) axis: AxisName,
    pub(super) table: SignTable,
    /// The tilt test that confirmed it.
    pub(super) tilt_test: Option<String>,
}

/// A sign table file.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct SignFile {
    pub(super) instrument: Option<String>,
    pub(super) set_ups: Vec<SetUp>,
}

impl SignFile {
    /// Reads and checks a file; every set-up must be a proper mapping and all must have the parity of one instrument.
    pub(super) fn read(path: &Path) -> Result<Self> {
        Self::parse(path, &input::read_text(path, InputKind::Description)?)
    }

    fn parse(path: &Path, text: &str) -> Result<Self> {
        let wire: FileWire = from_toml(path, text)?;
        if wire.format != FORMAT {
            return Err(mistake!(path, "format is \"{}\", expected \"{FORMAT}\"", wire.format));
        }
        let mut file = Self { instrument: wire.instrument, set_ups: Vec::new() };
        // in the order of all axes, of which the linear ones come first
        let set_ups = [wire.x, wire.y, wire.z, wire.u, wire.v, wire.w];
        for (axis, set_up) in AxisName::ALL.into_iter().zip(set_ups) {
            let Some(s) = set_up else { continue };
            let section = axis.lower();
            let mut channels = [None; 6];
            let words = [&s.distance, &s.horizontal, &s.vertical, &s.roll, &s.pitch, &s.yaw];
            for ((slot, word), channel) in channels.iter_mut().zip(words).zip(Channel::ALL) {
                let Some(word) = word else { continue };
                let shape = if channel.is_angle() { "\"+a\", \"-b\"" } else { "\"+x\", \"-y\"" };
                let what =
                    format!("{} = \"{word}\": write a sign and a direction, such as {shape}", channel.name());
                let assignment = Assignment::parse(word);
                *slot = Some(assignment.ok_or_else(|| mistake!(path, "[{section}] {what}"))?);
            }
            let table = SignTable { channels };
            table.check(axis).map_err(|e| mistake!(path, "[{section}] {e}"))?;
            file.set_ups.push(SetUp { axis, table, tilt_test: s.tilt_test });
        }
        file.one_parity(path)?;
        Ok(file)
    }

    /// The handedness of an angle belongs to the instrument, not to the set-up.
    fn one_parity(&self, path: &Path) -> Result<()> {
        for i in 0..3 {
            let mut known: Option<(AxisName, bool)> = None;
            for s in &self.set_ups {
                let Some(parity) = s.table.parity()[i] else { continue };
                match known {
                    Some((axis, p)) if p != parity => {
                        let ([a, b], name) =
                            ([axis, s.axis].map(AxisName::lower), Channel::ALL[i + 3].name());
                        return Err(mistake!(
                            path,
                            "[{a}] and [{b}] disagree on {name}: it is right-handed in one and left-handed in the other, which no turning of an instrument does; one sign of the two is wrong, a tilt test tells which"
                        ));
                    }
                    _ => known = Some((s.axis, parity)),
                }
            }
        }
        Ok(())
    }

    /// The set-up of an axis.
    pub(super) fn set_up(&self, axis: AxisName, path: &Path) -> Result<&SetUp> {
        self.set_ups.iter().find(|s| s.axis == axis).ok_or_else(|| {
            mistake!(path, "no section [{}] for the set-up along axis {axis}; add it", axis.lower())
        })
    }

    /// Whether a tilt test stands behind the signs; one set-up is enough, because parity belongs to the instrument.
    pub(super) fn is_confirmed(&self) -> bool {
        self.set_ups.iter().any(|s| s.tilt_test.is_some())
    }

    /// Replaces the set-up of an axis.
    pub(super) fn put(&mut self, set_up: SetUp) {
        self.set_ups.retain(|s| s.axis != set_up.axis);
        self.set_ups.push(set_up);
        self.set_ups.sort_by_key(|s| s.axis);
    }

    /// The file.
    pub(super) fn text(&self) -> String {
        let mut text = format!("format = \"{FORMAT}\"\n");
        if let Some(instrument) = &self.instrument {
            text.push_str(&format!("instrument = {instrument:?}\n"));
        }
        for s in &self.set_ups {
            text.push_str(&format!("\n[{}]\n", s.axis.lower()));
            for (channel, assignment) in Channel::ALL.into_iter().zip(s.table.channels) {
                if let Some(a) = assignment {
                    text.push_str(&format!("{} = \"{a}\"\n", channel.name()));
                }
            }
            if let Some(test) = &s.tilt_test {
                text.push_str(&format!("tilt-test = {test:?}\n"));
            }
        }
        text
    }
}

/// Columns of the channels that an instrument has.
pub(super) struct ChannelColumns([Option<Column>; 6]);

/// Column of a channel.
fn column_name(channel: Channel) -> String {
    format!("{}_{}", channel.name(), if channel.is_angle() { "arcsec" } else { "um" })
}

impl ChannelColumns {
    pub(super) fn find(table: &mut Columns) -> Self {
        Self(Channel::ALL.map(|c| table.find_column(&column_name(c))))
    }

    pub(super) fn has(&self) -> [bool; 6] {
        self.0.map(|c| c.is_some())
    }

    /// The channels of the current row in mm and rad; 0 where the instrument has none.
    pub(super) fn read(&self, row: &Columns) -> Result<[f64; 6]> {
        let mut values = [0.0; 6];
        for (value, column) in values.iter_mut().zip(self.0) {
            *value = column.map_or(Ok(0.0), |c| row.deviation(c))?;
        }
        Ok(values)
    }
}

/// Runs a tilt test from a file.
pub(super) fn read_tilt_test(path: &Path) -> Result<[Option<TiltFound>; 6]> {
    let mut table = table::open(path)?;
    let applied = ["x_um", "y_um", "z_um", "a_arcsec", "b_arcsec", "c_arcsec"];
    let applied = ChannelColumns(applied.map(|name| table.find_column(&format!("applied_e{name}"))));
    let channels = ChannelColumns::find(&mut table);
    table.only_known()?;
    let read = |row: &Columns| Ok(TiltReading { applied: applied.read(row)?, channels: channels.read(row)? });
    tilt_test(&table.rows(read)?, channels.has()).map_err(|e| Failure::data(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EX_CONFIG;

    const GOOD: &str = "format = \"volcomp-6d/1\"\ninstrument = \"6D 123\"\n\n[x]\ndistance = \"+x\"\nhorizontal = \"+y\"\n\
        vertical = \"+z\"\nroll = \"+a\"\npitch = \"+b\"\nyaw = \"+c\"\ntilt-test = \"tilt.csv\"\n";

    fn parse(text: &str) -> Result<SignFile, String> {
        SignFile::parse(Path::new("s.toml"), text).map_err(|f| {
            assert_eq!(f.code, EX_CONFIG);
            f.message
        })
    }

    #[test]
    fn a_file_reads_back() {
        let file = parse(GOOD).unwrap();
        assert_eq!(file.text(), GOOD);
        assert!(file.is_confirmed());
        let mut other = file.clone();
        other.put(SetUp { tilt_test: None, ..file.set_ups[0].clone() });
        assert!(!other.is_confirmed() && other.set_ups.len() == 1);
        assert!(
            file.set_up(AxisName::Y, Path::new("s.toml")).unwrap_err().message.contains("no section [y]")
        );
    }

    #[test]
    fn mistakes_are_named() {
        for (from, to, message) in [
            ("volcomp-6d/1", "volcomp-6d/9", "expected \"volcomp-6d/1\""),
            ("\"+y\"", "\"y\"", "[x] horizontal = \"y\": write a sign and a direction"),
            ("\"+z\"", "\"+y\"", "are both assigned y"),
            ("vertical", "vertikal", "unknown field `vertikal`"),
        ] {
            let error = parse(&GOOD.replace(from, to)).unwrap_err();
            assert!(error.contains(message), "{error}");
        }
        let y = "[y]\ndistance = \"+y\"\nhorizontal = \"-x\"\nvertical = \"+z\"\nroll = \"+b\"\npitch = \"-a\"\nyaw = \"-c\"\n";
        let error = parse(&format!("{GOOD}{y}")).unwrap_err();
        assert!(error.contains("[x] and [y] disagree on yaw"), "{error}");
        assert_eq!(parse(&format!("{GOOD}{}", y.replace("\"-c\"", "\"+c\""))).unwrap().set_ups.len(), 2);
    }
}
