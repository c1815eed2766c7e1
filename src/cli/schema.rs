//! `volcomp schema`: JSON Schema of machine, model and session files, made from the key table that reads them.

use crate::prelude::*;
use volcomp_config::{Allowed, Key, Shape, machine, model};

/// Pages whose tables say what a key means.
const MACHINE_PAGE: &str = include_str!("../../docs/reference/configuration.md");
const MODEL_PAGE: &str = include_str!("../../docs/reference/model-keys.md");
const SESSION_PAGE: &str = include_str!("../../docs/reference/session-files.md");
const DRAFT: &str = "https://json-schema.org/draft/2020-12/schema";

/// Print the JSON Schema of machine, model or session files, for editors and other programs
///
/// Editors that know TOML (taplo, Even Better TOML) complete and check keys with it. A session is a CSV file: its schema
/// is that of the list of its rows, each an object by column.
#[derive(Debug, clap::Parser)]
#[command(after_help = "Example:\n  volcomp schema machine > machine.schema.json")]
pub(super) struct Args {
    /// The kind of file.
    kind: Kind,
    /// One JSON object on stdout, which is all that this verb prints.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// `volcomp-machine/1`, TOML.
    Machine,
    /// `volcomp-model/1`, TOML.
    Model,
    /// Readings for volcomp diagnose, CSV.
    Session,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let schema = match args.kind {
        Kind::Machine => of_keys(machine::FORMAT, &machine::known_keys(), MACHINE_NAMES, MACHINE_PAGE),
        Kind::Model => of_keys(model::FORMAT, &model::known_keys(), MODEL_NAMES, MODEL_PAGE),
        Kind::Session => session(),
    };
    say!("{schema:#}");
    Ok(())
}

/// Names in the key table that stand for others: table, name, pattern of the names it stands for.
type Names = &'static [(&'static str, &'static str, &'static str)];

const MACHINE_NAMES: Names = &[("axes", "x", "^[xyzuvw]$"), ("axes", "c", "^[abc]$")];
const MODEL_NAMES: Names = &[
    ("axes", "x", "^[xyzuvw]$"),
    ("axes", "c", "^[abcs]$"),
    ("errors", "exx", "^e[xyz][xyzuvw]$"),
    ("errors", "eax", "^e[abc][xyzuvw]$"),
    ("errors", "exc", "^e[xyz][abcs]$"),
    ("errors", "eac", "^e[abc][abcs]$"),
    ("errors", "ec0y", "^e[abc]0[xyzuvwabcs]$"),
    ("errors", "ex0c", "^e[xyz]0[xyzuvwabcs]$"),
    ("thermal", "growth", "^.+$"),
    ("thermal", "growth-by-speed", "^.+$"),
    ("thermal", "expansion", "^.+$"),
    ("thermal", "expansion-by-speed", "^.+$"),
];

/// Keys named by the axes of the chain, below these tables.
const BY_AXIS: [(&str, Shape); 2] =
    [("grid", Shape::Numbers(None)), ("datum", Shape::Number(Allowed::Finite))];

/// A table of the key table, or a key where it has none below it.
#[derive(Default)]
struct Node {
    key: Key,
    below: BTreeMap<String, Node>,
}

impl Node {
    /// Takes in the keys of another variant of the table; required is what both require.
    fn merge(&mut self, other: Self) {
        self.key.required &= other.key.required;
        for (name, child) in &mut self.below {
            child.key.required &= other.below.contains_key(name);
        }
        for (name, mut child) in other.below {
            match self.below.get_mut(&name) {
                Some(own) => own.merge(child),
                None => {
                    child.key.required = false;
                    self.below.insert(name, child);
                }
            }
        }
    }

    /// The tables below it by the pattern of their names, where they stand for others: variants of one pattern merged.
    fn by_pattern(self, name: &str, names: Names) -> (BTreeMap<String, Self>, BTreeMap<&'static str, Self>) {
        let (mut properties, mut patterns) = (BTreeMap::new(), BTreeMap::<_, Self>::new());
        for (below, child) in self.below {
            match names.iter().find(|(table, sample, _)| *table == name && *sample == below) {
                None => {
                    properties.insert(below, child);
                }
                Some((.., pattern)) => match patterns.get_mut(pattern) {
                    Some(known) => known.merge(child),
                    None => {
                        patterns.insert(*pattern, child);
                    }
                },
            }
        }
        (properties, patterns)
    }
}

fn of_keys(format: &str, keys: &BTreeMap<String, Key>, names: Names, page: &str) -> Value {
    let mut root = Node::default();
    for (path, key) in keys {
        let node =
            path.split('.').fold(&mut root, |node, name| node.below.entry(name.to_owned()).or_default());
        node.key = key.clone();
    }
    let mut schema = table(root, "", &descriptions(page), names);
    schema["$schema"] = json!(DRAFT);
    schema["title"] = json!(format);
    schema["properties"]["format"] = json!({ "const": format });
    schema
}

/// The schema of a table with its keys.
fn table(node: Node, name: &str, help: &Help, names: Names) -> Value {
    let (mut keys, tables) = node.by_pattern(name, names);
    let by_axis = BY_AXIS.iter().find(|(table, _)| *table == name);
    if by_axis.is_some() {
        // the axes of the sample in the key table stand for any
        keys.retain(|key, _| !is_of_axis(key));
    }
    let required: Vec<String> =
        keys.iter().filter(|(_, child)| child.key.required).map(|(name, _)| name.clone()).collect();
    let property = |(below, child): (String, Node)| {
        let text = [name, ""].iter().find_map(|t| help.get(&((*t).to_owned(), below.clone())));
        let mut schema = schema(child, &below, help, names);
        if let Some(text) = text {
            schema["description"] = json!(text);
        }
        (below, schema)
    };
    let properties: Map<String, Value> = keys.into_iter().map(property).collect();
    let pattern = |(pattern, child): (&str, Node)| (pattern.to_owned(), schema(child, name, help, names));
    let mut patterns: Map<String, Value> = tables.into_iter().map(pattern).collect();
    if let Some((_, shape)) = by_axis {
        patterns.insert("^[xyzuvwabcs]-(mm|deg)$".to_owned(), value(shape));
    }
    json!({ "type": "object", "properties": properties, "patternProperties": patterns, "required": required,
        "additionalProperties": false })
}

/// A key named by an axis and the unit of its coordinate, such as `x-mm`.
fn is_of_axis(key: &str) -> bool {
    let letter = key.strip_suffix("-mm").or_else(|| key.strip_suffix("-deg"));
    letter.is_some_and(|letter| letter.len() == 1)
}

fn schema(node: Node, name: &str, help: &Help, names: Names) -> Value {
    let is_table = !node.below.is_empty() || BY_AXIS.iter().any(|(table, _)| *table == name);
    let Key { shape, default, .. } = node.key.clone();
    let mut schema = match (&shape, is_table) {
        (Shape::Tables, _) => {
            let one = table(node, name, help, names);
            json!({ "anyOf": [one, { "type": "array", "items": one }] })
        }
        (Shape::Table, _) | (_, true) => table(node, name, help, names),
        (shape, false) => value(shape),
    };
    if let Some(default) = default.filter(|d| d.is_finite()) {
        schema["default"] = json!(default);
    }
    schema
}

/// The schema of a value.
fn value(shape: &Shape) -> Value {
    match shape {
        Shape::Any => json!({}),
        Shape::Number(Allowed::Finite) => json!({ "type": "number" }),
        Shape::Number(Allowed::Positive { high }) => {
            json!({ "type": "number", "exclusiveMinimum": 0, "maximum": high })
        }
        Shape::Number(Allowed::Within { low, high }) => {
            json!({ "type": "number", "minimum": low, "maximum": high })
        }
        Shape::Whole(low, high) => json!({ "type": "integer", "minimum": low, "maximum": high }),
        Shape::Numbers(None) => json!({ "type": "array", "items": { "type": "number" } }),
        Shape::Numbers(Some(n)) => {
            json!({ "type": "array", "items": { "type": "number" }, "minItems": n, "maxItems": n })
        }
        Shape::Text => json!({ "type": "string" }),
        Shape::Texts => json!({ "type": "array", "items": { "type": "string" } }),
        Shape::Flag => json!({ "type": "boolean" }),
        Shape::Words(words) => json!({ "enum": words }),
        Shape::Table | Shape::Tables => json!({ "type": "object" }),
    }
}

/// Rows of a page's tables that begin with a key, each with the table of the file that it belongs to.
fn rows(page: &str) -> impl Iterator<Item = (String, Vec<&str>)> {
    let mut table = String::new();
    page.lines().filter_map(move |line| {
        let heading = line.strip_prefix("| ").unwrap_or(line);
        if let Some(path) = heading.strip_prefix("`[").and_then(|rest| rest.split(']').next()) {
            // `[axes.x]`, `[errors.SYMBOL.KIND]`: the first name; `[link.tls]`: the last
            let mut names = path.trim_start_matches('[').split('.');
            let is_name = |n: &&str| n.len() > 1 && n.chars().all(|c| c.is_ascii_lowercase() || c == '-');
            table = names.rfind(is_name).unwrap_or_default().to_owned();
        }
        let cells =
            line.starts_with("| `").then(|| line.trim_matches('|').split('|').map(str::trim).collect())?;
        Some((table.clone(), cells))
    })
}

/// Keys in a cell that holds nothing but keys, such as `` `std-um`, `std-arcsec` ``.
fn keys_of(cell: &str) -> Vec<&str> {
    let between: String = cell.split('`').step_by(2).collect();
    let is_keys = between.chars().all(|c| ", ".contains(c));
    cell.split('`').skip(1).step_by(2).filter(|_| is_keys).flat_map(|keys| keys.split([' ', ','])).collect()
}

/// A cell as plain text: no backticks, no targets of links.
fn plain(cell: &str) -> String {
    let mut text = String::new();
    let mut rest = cell;
    while let Some((before, behind)) = rest.split_once("](") {
        let (words, link) = before.rsplit_once('[').unwrap_or((before, ""));
        text.push_str(words);
        text.push_str(link);
        rest = behind.split_once(')').map_or("", |(_, behind)| behind);
    }
    (text + rest).replace('`', "")
}

/// What each key means, by table and key: the last cell of its row. Without a table, its first row.
type Help = BTreeMap<(String, String), String>;

fn descriptions(page: &str) -> Help {
    let mut found = Help::new();
    for (table, row) in rows(page) {
        let Some(text) = row.last().map(|cell| plain(cell)).filter(|text| !text.is_empty()) else { continue };
        for key in row.iter().take(2).flat_map(|cell| keys_of(cell)) {
            for table in [table.as_str(), ""] {
                found.entry((table.to_owned(), key.to_owned())).or_insert_with(|| text.clone());
            }
        }
    }
    found
}

/// The schema of the rows of a session file.
fn session() -> Value {
    let columns = SESSION_PAGE.split("\n### ").next().unwrap_or_default();
    let help = descriptions(columns);
    let whole = |name: &str| ["setup", "run", "repeat", "pair"].contains(&name);
    let mut properties = Map::new();
    let mut patterns = Map::new();
    for ((_, name), text) in help.iter().filter(|((table, _), _)| table.is_empty()) {
        let kind = match name.as_str() {
            "instrument" => json!({ "type": "string" }),
            name if whole(name) => json!({ "type": "integer" }),
            _ => json!({ "type": ["number", "null"] }),
        };
        let mut schema = kind;
        schema["description"] = json!(text);
        if name.contains('<') {
            let pattern = name.replace("<axis>", "[xyzabc]").replace("<name>", ".+");
            patterns.insert(format!("^{pattern}$"), schema);
        } else {
            properties.insert(name.clone(), schema);
        }
    }
    let required = ["t_s", "setup", "run", "repeat", "u_x", "u_y", "u_z", "deviation_um"];
    let positions = ["x_mm", "y_mm", "z_mm", "a_deg", "b_deg", "c_deg"].map(|c| json!({ "required": [c] }));
    json!({
        "$schema": DRAFT, "title": "volcomp session", "type": "array",
        "items": { "type": "object", "properties": properties, "patternProperties": patterns,
            "required": required, "anyOf": positions },
    })
}
