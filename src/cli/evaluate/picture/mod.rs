//! The plots of the standards.

pub(super) mod circular;
pub(super) mod gear;
pub(super) mod plate;
pub(super) mod positioning;
