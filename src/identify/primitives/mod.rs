//! Geometric primitives by orthogonal distance: circle, sphere, plane, circle in space, rigid registration.
//!
//! What they minimise is the sum of squared distances of the points from the figure, not an algebraic substitute.
//! Points are centred and scaled before anything is solved, so a circle 2 m from the origin costs no digits.
//! Covariances are given for coordinates of unit variance (`cofactor`); multiply by the variance of a coordinate.
//!
//! Source: equations 5.4. Reading order: [`mod@ball`], [`mod@plane`], [`mod@space_circle`], [`mod@rigid`].

pub mod ball;
pub(crate) mod jacobi;
pub mod plane;
pub mod rigid;
pub mod space_circle;
pub mod twist;

pub use ball::{Ball, BallError, Circle2, Sphere, circle_2d, sphere};
pub use plane::{Plane, PlaneError, plane};
pub use rigid::{RigidError, RigidFit, procrustes, register};
pub use space_circle::{SpaceCircle, SpaceCircleError, space_circle};
