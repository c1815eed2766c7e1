//! `volcomp import`: files of instruments and controls to the product's own tables and models.
//!
//! Nothing is written before everything was read: a damaged file leaves no output behind.

mod positioning;
mod series;
mod tables;

use clap::Parser;

use crate::prelude::*;
use volcomp_formats::columns::{ColumnMap, Delimiter};
use volcomp_formats::detect::{self, Format};
use volcomp_formats::heidenhain::Sign;
use volcomp_formats::linuxcnc::LinearUnit;
use volcomp_formats::rtl::DeviationUnit;
use volcomp_formats::text::{self, Decoded, Encoding};
use volcomp_formats::{isg, linuxcnc};

/// Read files of instruments and controls into volcomp's own tables and models.
///
/// Laser tests become `cycle,direction,target_mm,deviation_um`; captures `t_s` and columns that end in their units;
/// ballbar figures `feature,value,unit` (JSON where --out ends in .json); tables of controls a model file.
#[derive(Debug, Parser)]
#[command(after_help = include_str!("help.txt"))]
pub(super) struct Args {
    /// Files; several where they make one table or model. - is stdin.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// How the files are written; auto looks at their beginning.
    #[arg(long, value_parser = one_of(FORMATS), default_value = "auto")]
    format: Named,
    #[command(flatten)]
    model: ModelWriter,
    /// The axis that moved, or whose table it is.
    #[arg(long, value_name = "LETTER", value_parser = axis_letter)]
    axis: Option<AxisName>,
    /// Unit of the deviations of an .rtl of a rotary axis: the file does not say it.
    #[arg(long, value_parser = one_of(DEVIATION_UNITS))]
    deviation_unit: Option<DeviationUnit>,
    /// Encoding of a text file: utf-8, utf-16, cp1250, cp1252, gbk; guessed where missing.
    #[arg(long)]
    encoding: Option<Encoding>,
    /// An .rtx recorded with an angular optic: mrad instead of mm.
    #[arg(long)]
    angular: bool,
    /// Axes of an Edge capture by number, such as x=1,y=2,c=4; the letter decides between mm and deg.
    #[arg(long, value_delimiter = ',', value_name = "AXIS=NUMBER", value_parser = numbered_axis)]
    axes: Vec<(AxisName, u32)>,
    /// A column map in TOML for any other table.
    #[arg(long, value_name = "TOML", conflicts_with_all = ["columns", "delimiter", "decimal_comma", "skip_lines", "no_header"])]
    map: Option<PathBuf>,
    /// A column map as OUTPUT=COLUMN:UNIT, such as target=Soll:mm,deviation=#3:um.
    #[arg(long, value_delimiter = ',', value_name = "OUT=COLUMN:UNIT")]
    columns: Vec<String>,
    /// What separates columns: ; , | tab or blank; guessed where missing.
    #[arg(long)]
    delimiter: Option<Delimiter>,
    /// Numbers have a decimal comma.
    #[arg(long)]
    decimal_comma: bool,
    /// Lines above the table.
    #[arg(long, value_name = "N", default_value_t = 0)]
    skip_lines: usize,
    /// The table has no line with the names of its columns.
    #[arg(long)]
    no_header: bool,
    #[command(flatten)]
    control: ControlArgs,
    /// Size of an encoder increment for ISG leadscrew tables that count in them (rotary: 0.001 deg).
    #[arg(long, value_name = "UM")]
    increment_um: Option<f64>,
}

/// A format by name; none: what the beginning of the file gives away.
type Named = Option<Format>;

const FORMATS: &[(&str, &str, Named)] = &[
    ("auto", "Look at the beginning of the file", None),
    ("rtl", "Renishaw laser, static", Some(Format::Rtl)),
    ("rtx", "Renishaw laser, dynamic", Some(Format::Rtx)),
    ("b5r", "Renishaw ballbar, figures", Some(Format::B5r)),
    ("edge", "SINUMERIK Edge capture", Some(Format::Edge)),
    ("iso230-dat", "ISO 230-2 test of an ecmc logger", Some(Format::Iso230Dat)),
    ("api-pos", "API laser, means", Some(Format::ApiPos)),
    ("camonitor", "EPICS camonitor log", Some(Format::Camonitor)),
    ("columns", "Any table, with --columns or --map", Some(Format::Columns)),
    ("isg", "ISG and Beckhoff volumetric compensation", Some(Format::Isg)),
    ("isg-lis", "ISG and Beckhoff leadscrew compensation", Some(Format::IsgLis)),
    ("linuxcnc", "LinuxCNC screw compensation", Some(Format::LinuxCnc)),
    ("heidenhain", "Heidenhain .COM table", Some(Format::Heidenhain)),
];

pub(super) const DEVIATION_UNITS: &[(&str, &str, DeviationUnit)] = &[
    ("um", "", DeviationUnit::Um),
    ("mrad", "", DeviationUnit::Mrad),
    ("urad", "", DeviationUnit::Urad),
    ("arcsec", "", DeviationUnit::Arcsec),
];
const LINEAR_UNITS: &[(&str, &str, LinearUnit)] =
    &[("mm", "", LinearUnit::Mm), ("inch", "", LinearUnit::Inch)];
const SENSES: &[(&str, &str, isg::Body)] = &[
    ("relative", "The tool relative to the workpiece", isg::Body::Relative),
    ("carriage", "The carriage itself", isg::Body::Carriage),
];
const SIGNS: &[(&str, &str, Sign)] = &[
    ("deviation", "Actual - nominal", Sign::Deviation),
    ("correction", "Nominal - actual", Sign::Correction),
];

/// What the tables of controls leave open.
#[derive(Debug, clap::Args)]
pub(super) struct ControlArgs {
    /// COMP_FILE_TYPE of LinuxCNC: 0 actual positions, 1 trims.
    #[arg(long, value_name = "0|1", value_parser = comp_type)]
    pub(super) comp_type: Option<linuxcnc::CompType>,
    /// LINEAR_UNITS of the LinuxCNC machine [default: mm].
    #[arg(long, value_parser = one_of(LINEAR_UNITS))]
    pub(super) linear_units: Option<LinearUnit>,
    /// Whose motion an ISG control takes the values of workpiece-side axes for.
    #[arg(long, value_parser = one_of(SENSES))]
    pub(super) sense: Option<isg::Body>,
    /// What a Heidenhain control takes its values for: actual - nominal, or its opposite.
    #[arg(long, value_parser = one_of(SIGNS))]
    pub(super) sign: Option<Sign>,
}

impl ControlArgs {
    /// LINEAR_UNITS, mm where nothing is said.
    pub(super) fn linear_unit(&self) -> LinearUnit {
        self.linear_units.unwrap_or(LinearUnit::Mm)
    }
}

fn numbered_axis(text: &str) -> Result<(AxisName, u32), String> {
    let (axis, number) = text.split_once('=').ok_or("write for example x=1")?;
    let number = number.parse().map_err(|_| format!("invalid axis number '{number}'"))?;
    Ok((axis_letter(axis)?, number))
}

fn comp_type(text: &str) -> Result<linuxcnc::CompType, String> {
    match text {
        "0" => Ok(linuxcnc::CompType::Actual),
        "1" => Ok(linuxcnc::CompType::Trim),
        _ => Err(format!("invalid COMP_FILE_TYPE '{text}'; expected 0 or 1")),
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let first = &args.files[0];
    let is_described = args.map.is_some() || !args.columns.is_empty();
    let format = args.format.or(is_described.then_some(Format::Columns));
    let format = format.map_or_else(|| one_format(&args.files), Ok)?;
    match format {
        Format::Rtl | Format::Iso230Dat | Format::ApiPos => positioning::run(args, format),
        Format::Columns if args.column_map()?.is_test() => positioning::run(args, format),
        Format::Isg | Format::IsgLis | Format::LinuxCnc | Format::Heidenhain => tables::run(args, format),
        _ if args.files.len() > 1 => Err(Failure::usage("files of this kind are imported one by one")),
        Format::Rtx => series::rtx(args, first),
        Format::Edge => series::edge(args, first),
        Format::Camonitor => series::camonitor(args, first),
        Format::B5r => series::b5r(args, first),
        Format::Columns => series::columns(args, first),
    }
}

/// The format of all files by their beginnings.
fn one_format(files: &[PathBuf]) -> Result<Format> {
    let (first, format) = (files[0].display(), detected(&files[0])?);
    for file in &files[1..] {
        if detected(file)? != format {
            let file = file.display();
            return Err(usage!("{first} and {file} are of different formats; import them one by one"));
        }
    }
    Ok(format)
}

/// The format of a file by its beginning.
fn detected(path: &Path) -> Result<Format> {
    if path.as_os_str() == "-" {
        return Err(Failure::usage("stdin cannot be looked at first; give its --format"));
    }
    let head = input::head(path, InputKind::Stream, detect::HEAD as u64)?;
    if head.is_empty() {
        return Err(Failure::data(path, "the file is empty; is it the right one?"));
    }
    detect::format(&head).ok_or_else(|| {
        usage!(
            "{}: its beginning does not give its format away; name it with --format, or describe the table with --columns or --map",
            path.display()
        )
    })
}

impl Args {
    /// The file to write.
    fn out(&self) -> Result<&Path> {
        self.model.out.as_deref().ok_or_else(|| usage!("--out is not given; - is stdout"))
    }

    fn column_map(&self) -> Result<ColumnMap> {
        let (mut map, name) = match &self.map {
            Some(path) => {
                let file = path.display().to_string();
                let bytes = input::read(path, InputKind::Description)?;
                let map = ColumnMap::from_toml(&text::decode(&bytes).text);
                (map.map_err(|e| format_failure(&file, &e))?, file)
            }
            None => {
                let mut map = ColumnMap {
                    delimiter: self.delimiter,
                    decimal_comma: self.decimal_comma,
                    skip_lines: self.skip_lines,
                    header: !self.no_header,
                    ..ColumnMap::default()
                };
                for column in &self.columns {
                    let (output, source) = column
                        .split_once('=')
                        .ok_or_else(|| usage!("--columns {column}: write OUTPUT=COLUMN:UNIT"))?;
                    map.add(output.trim(), source).map_err(|e| usage!("--columns {column}: {e}"))?;
                }
                (map, "--columns".to_owned())
            }
        };
        map.encoding = map.encoding.or(self.encoding);
        map.check().map_err(|e| usage!("{name}: {e}"))?;
        Ok(map)
    }

    /// The text of a file in the stated or guessed encoding.
    fn decode<'a>(&self, file: &str, bytes: &'a [u8]) -> Result<Decoded<'a>> {
        match self.encoding {
            Some(encoding) => text::decode_as(bytes, encoding).map_err(|e| format_failure(file, &e)),
            None => Ok(text::decode(bytes)),
        }
    }
}

/// Notes a list, where it has an item.
fn note_list(what: &str, list: impl Iterator<Item: core::fmt::Display>) {
    let list = list.joined(", ");
    if !list.is_empty() {
        note!("  {what}{list}");
    }
}

/// ` (cp1252 text, guessed)` where a file is not plain UTF-8.
fn encoding_note(text: &Decoded<'_>) -> String {
    match (text.encoding, text.guessed) {
        (Encoding::Utf8, _) => String::new(),
        (encoding, true) => format!(" ({} text, a guess; --encoding states it)", encoding.name()),
        (encoding, false) => format!(" ({} text)", encoding.name()),
    }
}
