//! One case out of a file of reference vectors, or the file that is a case itself.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value;

use super::case;
use crate::cli::{EX_DATAERR, EX_USAGE, Failure};

/// Reads a case; of a file with several, the one named `id`.
pub(super) fn read_case<T: DeserializeOwned>(path: &Path, id: Option<&str>) -> Result<T, Failure> {
    let mut file: Value = case::read(path)?;
    let name = path.display();
    let value = match file.get_mut("cases").and_then(Value::as_array_mut) {
        None => file,
        Some(cases) => {
            let ids: Vec<&str> = cases.iter().filter_map(|c| c["id"].as_str()).collect();
            let Some(id) = id else {
                return Err(Failure::new(
                    EX_USAGE,
                    format_args!(
                        "error: {name} holds {} cases; choose one by --case: {}",
                        cases.len(),
                        ids.join(", ")
                    ),
                ));
            };
            let Some(index) = cases.iter().position(|c| c["id"] == id) else {
                return Err(Failure::new(
                    EX_DATAERR,
                    format_args!("error: {name}: no case {id}; found {}", ids.join(", ")),
                ));
            };
            cases.swap_remove(index)
        }
    };
    serde_json::from_value(value).map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {name}: {e}")))
}
