//! Search for the minimum of a function of one number.

/// Golden-section search for the minimum of `f` on `[a, b]`: place and value; ends at a relative width.
pub(crate) fn golden(f: &mut impl FnMut(f64) -> f64, mut a: f64, mut b: f64, tolerance: f64) -> (f64, f64) {
    let ratio = (5f64.sqrt() - 1.0) / 2.0;
    let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut fc, mut fd) = (f(c), f(d));
    while (b - a).abs() > tolerance * (a.abs() + b.abs()) {
        if fc <= fd {
            (b, d, fd) = (d, c, fc);
            c = b - ratio * (b - a);
            fc = f(c);
        } else {
            (a, c, fc) = (c, d, fd);
            d = a + ratio * (b - a);
            fd = f(d);
        }
    }
    if fc <= fd { (c, fc) } else { (d, fd) }
}
