//! Log lines and counts of maps and thermal displacements that stand otherwise than before.

use tracing::{info, warn};

use super::worker::Shared;
use crate::sensor_status::growth_code;
use volcomp_engine::fault::Code;
use volcomp_estimate::live::{MapCondition, ThermalStatus};

/// A map stands otherwise than before.
pub(super) fn log_map(map: &str, before: MapCondition, now: MapCondition, shared: &Shared) {
    let warned = |code: Code, text: &str| {
        warn!(map, %code, "{text}");
        shared.count(code, map);
    };
    if now.limited && !before.limited {
        warned(Code::MAP_LIMITED, "the map exceeds its limit; the limit is used");
    } else if before.limited && !now.limited {
        info!(map, "the map is within its limit again");
    }
    match (now.alarm, now.is_static) {
        of if of == (before.alarm, before.is_static) => {}
        (_, true) => warned(Code::MAP_STATIC, "the map is given up for the static model"),
        (true, false) => warned(Code::MAP_ALARM, "a sensor contradicts the map"),
        (false, false) => info!(map, "the map is learned again"),
    }
}

/// A thermal displacement stands otherwise than before.
pub(super) fn log_thermal(growth: &str, status: ThermalStatus, input: &str) {
    let code = growth_code(status).map(|code| code.to_string());
    match status {
        ThermalStatus::Waiting(_) => {}
        ThermalStatus::Used => info!(growth, "the thermal displacement is used"),
        ThermalStatus::Outside(_) => {
            warn!(
                growth,
                input, code, "an input is outside the range of the fit; the thermal displacement fades"
            );
        }
        ThermalStatus::Lost(_) => {
            warn!(growth, input, code, "an input is lost; the thermal displacement is held, then taken back");
        }
    }
}
