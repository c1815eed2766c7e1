use super::*;

#[test]
fn an_angle_with_one_lever_stands_behind_the_displacements_that_it_makes() {
    let behind = Label::new("angular", "eaz");
    let one_lever = vec![OneLever { label: behind.clone(), over: Axis::Z, along: [false, true, false] }];
    let library = Library { one_lever, ..Library::default() };
    let curve = |along, over| {
        Shape::Polynomial(forms::Polynomial { along, over, low: 2, high: 5, centre_mm: 0.0, half_mm: 1.0 })
    };
    let square = |along, over| Shape::Squareness(forms::Squareness { along, over });
    for (shape, is_behind) in [
        (curve(Axis::Y, Axis::Z), true),
        (curve(Axis::X, Axis::Z), false),
        (curve(Axis::Y, Axis::X), false),
        (square(Axis::Y, Axis::Z), true),
        (square(Axis::Z, Axis::Y), true),
        (square(Axis::X, Axis::Z), false),
        (Shape::Scale(forms::Scale { axis: Axis::Y }), false),
    ] {
        assert_eq!(library.behind(&shape).eq([&behind]), is_behind, "{shape:?}");
    }
}

#[test]
fn a_straight_line_over_a_part_of_the_travel_may_be_the_slope_of_a_curve() {
    let library = Library { partly: [false, false, true], ..Library::default() };
    let square = |along, over| Shape::Squareness(forms::Squareness { along, over });
    for (shape, may) in [
        (square(Axis::Y, Axis::Z), true),
        (square(Axis::X, Axis::Y), false),
        (Shape::Scale(forms::Scale { axis: Axis::Z }), true),
        (Shape::Scale(forms::Scale { axis: Axis::X }), false),
        (Shape::ToolLength(forms::ToolLength {}), false),
    ] {
        assert_eq!(library.may_be_a_slope(&shape), may, "{shape:?}");
    }
}
