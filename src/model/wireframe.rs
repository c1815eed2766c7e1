//! The working volume of X, Y, Z as a wire grid with the deviation of the tool tip along its wires: for pictures.

use crate::prelude::*;
use crate::search::reference_pose;

/// Wires per direction.
const WIRES: usize = 5;
/// Share of the diagonal of the box that the largest deviation fills at most.
const SHOWN: f64 = 0.09;
/// Share of the shortest edge of the box that it fills at most.
const SHOWN_OF_SHORTEST: f64 = 0.6;

/// One direction of the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// X, Y or Z.
    pub axis: AxisName,
    /// Index of the axis in the chain.
    pub index: usize,
    /// Ends of the domain, mm ([`ModelSpec::domain`]).
    pub range: [f64; 2],
}

/// A wire of the box.
#[derive(Debug, Clone, PartialEq)]
pub struct Wire {
    /// Programmed places of the axes and deviations of the tool tip there, mm.
    pub points: Vec<(Vec3, Vec3)>,
    /// True where it lies on a face that a reader at large X, small Y, large Z sees.
    pub front: bool,
}

/// The wires on the surface of the box; in an area or a line all of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Wireframe {
    /// The linear axes X, Y, Z that have a domain.
    pub edges: Vec<Edge>,
    /// The wires; all other axes stand at home.
    pub wires: Vec<Wire>,
    /// Whether the chain has rotary axes.
    pub rotary: bool,
}

impl Wireframe {
    /// The wires of a model, `points` intervals each; `None` where none of X, Y, Z has a domain.
    #[must_use]
    pub fn of(spec: &ModelSpec, model: &Model, points: usize) -> Option<Self> {
        let edges = edges(spec);
        if edges.is_empty() {
            return None;
        }
        let rotary = spec.chain.axes().iter().any(|a| a.kind() == AxisKind::Rotary);
        Some(Self { wires: wires(spec, model, &edges, points.max(1)), edges, rotary })
    }

    /// Largest deviation on the wires, mm.
    #[must_use]
    pub fn largest(&self) -> f64 {
        let points = self.wires.iter().flat_map(|w| &w.points);
        points.map(|(_, deviation)| deviation.norm()).fold(0.0, f64::max)
    }

    /// A round number that makes the largest deviation a visible part of the box.
    #[must_use]
    pub fn magnification(&self) -> f64 {
        magnification(&self.edges.iter().map(Edge::length).collect::<Vec<_>>(), self.largest())
    }
}

impl Edge {
    fn length(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    fn is_front(&self, place: usize) -> bool {
        place == if self.axis == AxisName::Y { 0 } else { WIRES - 1 }
    }

    fn at(&self, share: f64) -> f64 {
        self.range[0] + share * (self.range[1] - self.range[0])
    }
}

/// The linear axes X, Y, Z that have a domain.
#[must_use]
pub fn edges(spec: &ModelSpec) -> Vec<Edge> {
    let main = [AxisName::X, AxisName::Y, AxisName::Z].into_iter();
    main.filter_map(|axis| Some(Edge { axis, index: spec.chain.index_of(axis)?, range: spec.domain(axis)? }))
        .collect()
}

fn wires(spec: &ModelSpec, model: &Model, edges: &[Edge], points: usize) -> Vec<Wire> {
    let mut out = Vec::new();
    for (d, along) in edges.iter().enumerate() {
        let others: Vec<&Edge> = edges.iter().enumerate().filter(|(i, _)| *i != d).map(|(_, e)| e).collect();
        for index in 0..WIRES.pow(others.len() as u32) {
            let places = [index % WIRES, index / WIRES];
            let inside = |i: usize| (1..WIRES - 1).contains(&places[i]);
            if others.len() == 2 && inside(0) && inside(1) {
                continue;
            }
            let mut pose = reference_pose(spec);
            for (edge, place) in others.iter().zip(places) {
                pose.position[edge.index] = edge.at(place as f64 / (WIRES - 1) as f64);
            }
            let wire = (0..=points).map(|i| {
                pose.position[along.index] = along.at(i as f64 / points as f64);
                let mut place = Vec3::zeros();
                for edge in edges {
                    place[edge.axis.direction()] = pose.position[edge.index];
                }
                (place, model.deviation(&pose).position)
            });
            let points = wire.collect();
            out.push(Wire { points, front: others.iter().zip(places).any(|(e, place)| e.is_front(place)) });
        }
    }
    out
}

fn magnification(edges: &[f64], largest: f64) -> f64 {
    if largest <= 0.0 {
        return 1.0;
    }
    let diagonal = edges.iter().map(|e| e * e).sum::<f64>().sqrt();
    let shortest = edges.iter().copied().fold(f64::INFINITY, f64::min);
    let wanted = (SHOWN * diagonal).min(SHOWN_OF_SHORTEST * shortest) / largest;
    let power = 10f64.powf(wanted.log10().floor());
    let round = [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|m| *m <= wanted);
    round.unwrap_or(power).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magnifications_are_round() {
        for (edges, largest, expected) in [
            (&[1000.0][..], 0.05, 1000.0),
            (&[1000.0], 0.02, 2000.0),
            (&[20000.0, 3000.0, 1200.0], 0.3, 2000.0),
            (&[500.0], 0.0, 1.0),
            (&[1.0], 1.0, 1.0),
        ] {
            assert!((magnification(edges, largest) - expected).abs() < 1e-9, "{edges:?} {largest}");
        }
    }
}
