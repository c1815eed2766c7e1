//! The machine file and the model it names, read once at start.

mod additions;

use std::io;
use std::path::{Path, PathBuf};

use volcomp_state::bounded_read::{MACHINE_BYTES_MAX, MODEL_BYTES_MAX, in_words, read_bounded};

pub use additions::with_additions;

use super::http::{Token, TokenError};
use super::models::Prepared;
use super::tls::{self, Identity, TlsFileError};
use volcomp_config::machine::ModelMismatch;
use volcomp_config::{ConfigErrors, MachineConfig, model};
use volcomp_effects::extend::Fate;
use volcomp_engine::fault::Code;
use volcomp_model::{Model, ModelError};
use volcomp_units::axes::AxisName;

/// Everything that comes from files.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The machine file.
    pub config: MachineConfig,
    /// The model that it names; with additions, its text is as `volcomp model extend` writes it.
    pub model: Prepared,
    /// The machine file as it was read.
    pub config_text: String,
    /// What became of the effects of additions, by label.
    pub fates: Vec<(String, Fate)>,
    /// Axes of the model that the machine file does not list: they are never offset.
    pub uncorrected: Vec<AxisName>,
    /// Who the daemon is on a link over TLS; `None` is plain TCP.
    pub identity: Option<Identity>,
    /// What commands by HTTP need; `None`: there are none.
    pub http_token: Option<Token>,
}

/// Why the daemon cannot start from these files.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// A file could not be read.
    #[error("error: {}: {}", path.display(), in_words(path, source))]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The model or an addition that the machine file names could not be read.
    #[error(
        "error: {}: {what} {}: {}\n  hint: {named} taken relative to the machine file",
        config.display(), path.display(), in_words(path, source)
    )]
    ReadNamed {
        /// The machine file.
        config: PathBuf,
        /// What the file is.
        what: &'static str,
        /// The key that names it, with its verb.
        named: &'static str,
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file is not text.
    #[error("error: {}: byte {at} is not UTF-8\n  hint: save the file as UTF-8 text", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// First byte that is not.
        at: usize,
    },
    /// Mistakes in a file.
    #[error("{0}")]
    Config(Box<ConfigErrors>),
    /// The files of `[link.tls]`.
    #[error("error: {}: {source}", config.display())]
    Tls {
        /// The machine file.
        config: PathBuf,
        /// What is wrong.
        source: Box<TlsFileError>,
    },
    /// The file of `[http] token-file`.
    #[error("error: {}: {source}", config.display())]
    Token {
        /// The machine file.
        config: PathBuf,
        /// What is wrong.
        source: TokenError,
    },
    /// The model breaks a rule.
    #[error("error: {}: {source}", path.display())]
    Model {
        /// The model file.
        path: PathBuf,
        /// The rule.
        source: ModelError,
    },
    /// The model does not belong to the machine file.
    #[error(
        "error: {}: {}{source} ({})\n  hint: {}", config.display(), number(source), path.display(), source.remedy()
    )]
    Mismatch {
        /// The machine file.
        config: PathBuf,
        /// The model file.
        path: PathBuf,
        /// What does not fit.
        source: ModelMismatch,
    },
    /// An addition that the machine file names cannot become part of the model.
    #[error(
        "error: {}: addition {}: {why}\n  hint: `additions` are addition.toml files of volcomp diagnose for this machine",
        config.display(), path.display()
    )]
    Addition {
        /// The machine file.
        config: PathBuf,
        /// The addition.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The machine file names another content.
    #[error("{}", Self::pinned(&path.display().to_string(), found, pinned))]
    Pinned {
        /// The model file.
        path: PathBuf,
        /// Its hash.
        found: String,
        /// The hash in the machine file.
        pinned: String,
    },
}

/// The number of what does not fit, where it has one.
pub(super) fn number(source: &ModelMismatch) -> String {
    match source {
        ModelMismatch::Machine { .. } => format!("{}: ", Code::MODEL_FOREIGN),
        ModelMismatch::AxisNotInChain { .. } | ModelMismatch::Spindle { .. } => String::new(),
    }
}

impl LoadError {
    /// The words for a model that is not the one whose hash the machine file holds.
    pub(super) fn pinned(file: &str, found: &str, pinned: &str) -> String {
        format!(
            "error: {file}: {}: its hash is {found}, the machine file's [guard] hash is {pinned}\n  \
             hint: if the file is right, write its hash into the machine file",
            Code::MODEL_HASH
        )
    }

    /// True where a file could not be read at all, false where what it says is wrong.
    #[must_use]
    pub const fn is_io(&self) -> bool {
        match self {
            Self::Read { .. } | Self::ReadNamed { .. } => true,
            Self::Tls { source, .. } => source.is_io(),
            Self::Token { source, .. } => source.is_io(),
            Self::NotText { .. }
            | Self::Config(_)
            | Self::Model { .. }
            | Self::Mismatch { .. }
            | Self::Addition { .. }
            | Self::Pinned { .. } => false,
        }
    }
}

/// The machine file and its text.
fn read_config(path: &Path) -> Result<(MachineConfig, String), LoadError> {
    let bytes = read_bounded(path, MACHINE_BYTES_MAX)
        .map_err(|source| LoadError::Read { path: path.to_owned(), source })?;
    let text = text(path, &bytes)?;
    let config = MachineConfig::parse(&path.display().to_string(), text)
        .map_err(|e| LoadError::Config(Box::new(e)))?;
    Ok((config, text.to_owned()))
}

/// A file that the machine file `config` names: what it is, and the key that names it with its verb.
fn read_named(config: &Path, path: &Path, [what, named]: [&'static str; 2]) -> Result<Vec<u8>, LoadError> {
    read_bounded(path, MODEL_BYTES_MAX).map_err(|source| {
        let (config, path) = (config.to_owned(), path.to_owned());
        LoadError::ReadNamed { config, what, named, path, source }
    })
}

/// Reads a machine file and the model it names, relative to it.
///
/// # Errors
/// See [`LoadError`].
pub fn load(path: &Path) -> Result<Loaded, LoadError> {
    let (config, config_text) = read_config(path)?;
    let model_path = path.with_file_name(&config.model);
    let bytes = read_named(path, &model_path, ["model", "`model` is"])?;
    let mut model_text = text(&model_path, &bytes)?.to_owned();
    let mut file = model::parse_file(&model_path.display().to_string(), &model_text)
        .map_err(|e| LoadError::Config(Box::new(e)))?;
    let fates = with_additions(path, &config, (&mut file, &model_text))?;
    if !fates.is_empty() {
        model_text = model::write_file(&file, &[format!("{} with additions.", config.model.display())]);
    }
    let model =
        Model::new(&file.spec).map_err(|source| LoadError::Model { path: model_path.clone(), source })?;
    if let Some(source) = config.check_model(&file.spec).into_iter().next() {
        return Err(LoadError::Mismatch { config: path.to_owned(), path: model_path, source });
    }
    let model = Prepared::new(&model_path.display().to_string(), model_text, file, model);
    let uncorrected = config.uncorrected_axes(&model.spec);
    if let Some(pinned) = config.guard.hash.clone().filter(|pinned| *pinned != model.hash) {
        return Err(LoadError::Pinned { path: model_path, found: model.hash, pinned });
    }
    let identity = tls::identity(path, &config)
        .map_err(|source| LoadError::Tls { config: path.to_owned(), source: Box::new(source) })?;
    let http_token = Token::of(path, &config.http)
        .map_err(|source| LoadError::Token { config: path.to_owned(), source })?;
    Ok(Loaded { config, model, config_text, fates, uncorrected, identity, http_token })
}

pub(super) fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, LoadError> {
    core::str::from_utf8(bytes).map_err(|e| LoadError::NotText { path: path.to_owned(), at: e.valid_up_to() })
}
