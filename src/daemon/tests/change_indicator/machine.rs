//! A machine file and a model as text and compiled, as they stand in a recording.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use volcomp_config::{MachineConfig, model};
use volcomp_estimate::Thermal;
use volcomp_model::{Model, ModelSpec};
use volcomp_protocol::{Axis, AxisUnit, ControlHello, Name, PROTOCOL_VERSION};
use volcomp_units::NS_PER_S;
use volcomp_units::axes::{AxisKind, AxisName};

/// A machine file with its model.
#[derive(Debug, Clone)]
pub(crate) struct Machine {
    pub(crate) config: MachineConfig,
    pub(crate) config_text: String,
    pub(crate) model: Arc<Model>,
    pub(crate) model_text: String,
    pub(crate) spec: ModelSpec,
    pub(crate) thermal: Vec<Thermal>,
}

/// BLAKE3 of a text.
pub(crate) fn hash_of(text: &str) -> [u8; 32] {
    *blake3::hash(text.as_bytes()).as_bytes()
}

/// A model from its text.
pub(crate) fn model_of(text: &str) -> Arc<Model> {
    let spec = model::parse("model.toml", text).unwrap_or_else(|errors| panic!("{errors}"));
    Arc::new(Model::new(&spec).expect("a valid model"))
}

impl Machine {
    pub(crate) fn parse(config_text: String, model_text: String) -> Self {
        let config =
            MachineConfig::parse("machine.toml", &config_text).unwrap_or_else(|errors| panic!("{errors}"));
        let file = model::parse_file("model.toml", &model_text).unwrap_or_else(|errors| panic!("{errors}"));
        let model = Arc::new(Model::new(&file.spec).expect("a valid model"));
        Self { config, config_text, model, model_text, spec: file.spec, thermal: file.thermal }
    }

    /// A machine of `config/examples` with parts of its machine file replaced and text appended to both files.
    pub(crate) fn example(name: &str, replaced: &[(&str, &str)], appended: [&str; 2]) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/examples").join(name);
        let read = |file: &str| fs::read_to_string(folder.join(file)).expect("an example");
        let mut config_text = read("machine.toml");
        for (old, new) in replaced {
            assert!(config_text.contains(old), "{name}/machine.toml has no {old:?}");
            config_text = config_text.replace(old, new);
        }
        Self::parse(config_text + appended[0], read("model.toml") + appended[1])
    }

    /// The hello of a control with the axes of the model, spindle excluded.
    pub(crate) fn hello(&self) -> ControlHello {
        let axes: Vec<Axis> = self.axis_names().map(axis).collect();
        ControlHello {
            version: PROTOCOL_VERSION,
            machine: Name::new(&self.config.machine),
            software: Name::new("change indicator"),
            cycle_ns: (self.config.link.cycle_s * NS_PER_S).round() as u64,
            axis_count: u8::try_from(axes.len()).expect("at most eight axes"),
            axes: std::array::from_fn(|k| axes.get(k).copied().unwrap_or(axes[0])),
        }
    }

    /// Axes in wire order.
    pub(crate) fn axis_names(&self) -> impl Iterator<Item = AxisName> + '_ {
        self.model.axes().filter(|axis| !axis.spindle).map(|axis| axis.name)
    }
}

const fn axis(name: AxisName) -> Axis {
    let unit = match name.kind() {
        AxisKind::Linear => AxisUnit::Millimetre,
        AxisKind::Rotary => AxisUnit::Degree,
    };
    Axis { name, unit }
}
