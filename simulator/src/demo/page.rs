//! The page of the demo: self-contained HTML with the picture, the table and what it all means.

use super::{Outcome, Scene};

/// The page as text.
pub(super) fn html(outcome: &Outcome, scene: &Scene, svg: &str) -> String {
    let mut rows = String::new();
    for (name, how, pair) in outcome.table() {
        rows.push_str(&format!(
            "<tr><td>{name}<br><small>{how}</small></td><td>{:.1}</td><td>{:.1}</td><td>{:.0} %</td></tr>\n",
            pair.before_um,
            pair.after_um,
            100.0 * pair.reduction()
        ));
    }
    let left: String = outcome.what_is_left().iter().map(|line| format!("<li>{line}</li>\n")).collect();
    let files: String = scene
        .files()
        .iter()
        .map(|(name, what)| format!("<li><a href=\"{name}\">{name}</a>: {what}</li>\n"))
        .collect();
    format!(
        r#"<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>volcomp demo: {machine}</title>
<style>
  body {{ font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 1200px; margin: 2rem auto; padding: 0 1rem; }}
  h1 {{ font-size: 1.6rem; margin-bottom: 0.2rem; }}
  p.lead {{ font-size: 1.1rem; margin-top: 0; }}
  svg {{ width: 100%; height: auto; }}
  table {{ border-collapse: collapse; margin: 1rem 0; }}
  th, td {{ padding: 0.4rem 1.2rem 0.4rem 0; text-align: right; border-bottom: 1px solid #ddd; vertical-align: top; }}
  th:first-child, td:first-child {{ text-align: left; }}
  small {{ color: #555; }}
  footer {{ color: #555; margin-top: 2rem; border-top: 1px solid #ddd; padding-top: 0.5rem; }}
  @media print {{ body {{ margin: 0; max-width: none; }} }}
</style>
</head>
<body>
<h1>{machine}: the same machine, without and with volcomp</h1>
<p class="lead">A simulated vertical machining centre with 21 geometric errors was surveyed, a model was fitted to the survey,
and the daemon corrected the machine over TCP while it moved.</p>
{svg}
<table>
<tr><th>measured</th><th>without / µm</th><th>with / µm</th><th>gone</th></tr>
{rows}</table>
<h2>What is left, and why</h2>
<ul>
{left}</ul>
<h2>How it was done</h2>
<ul>
{files}</ul>
<footer>Seed {seed}, cycle {cycle_ms} ms. The simulated machine is written independently of volcomp's model, with exact
rotations, servo lag, lost motion, encoder quantisation and noise. The recorded motion is that of a SINUMERIK 840D sl.
Circularity is G of ISO 230-4 (radial range about the least-squares circle, both directions); the diagonal figure is the
range of the deviation along the worst of the four body diagonals of ISO 230-6.</footer>
</body>
</html>
"#,
        machine = scene.machine,
        seed = scene.seed,
        cycle_ms = scene.cycle_s * 1e3,
    )
}
