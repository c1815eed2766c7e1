//! Comments cite sections of `docs/reference`, and pages link to each other: every citation and every link resolves.
//!
//! In comments `equations 5.4` is section 5.4 of `docs/reference/equations.md` and the pages below it; a page is cited by
//! its path, `docs/reference/files.md` or `docs/reference/files.md` 2 (its section 2). A file that cites equations names
//! that page, or the `mod.rs` or `lib.rs` of a folder above it does.

#![expect(clippy::disallowed_methods, reason = "a test reads files")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const EQUATIONS: &str = "docs/reference/equations.md";
/// Folders with sources.
const SOURCES: [&str; 5] = ["src", "simulator", "tests", "benches", "fuzz"];
/// Folders with pages, beside the root itself.
const PAGES: [&str; 4] = ["docs", "adapters", "fuzz", "tests"];
/// Citations and links that are there at least: fewer mean that this test does not see them any more.
const CITATIONS_MIN: usize = 120;
const PATHS_MIN: usize = 100;
const LINKS_MIN: usize = 220;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Files below a folder with an ending, in order; build folders are left out.
fn files(folder: &Path, ending: &str, into: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    paths.sort();
    for path in paths {
        if !path.is_dir() {
            if path.extension().is_some_and(|e| e == ending) {
                into.push(path);
            }
        } else if !path.ends_with("target") {
            files(&path, ending, into);
        }
    }
}

fn sources() -> Vec<PathBuf> {
    let mut all = Vec::new();
    for folder in SOURCES {
        files(&root().join(folder), "rs", &mut all);
    }
    // its examples of citations are no citations
    all.retain(|path| !path.ends_with("repository/reference_pages.rs"));
    all
}

fn pages() -> Vec<PathBuf> {
    let mut all = Vec::new();
    for folder in PAGES {
        files(&root().join(folder), "md", &mut all);
    }
    let top = std::fs::read_dir(root()).unwrap_or_else(|e| panic!("{e}"));
    all.extend(top.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "md")));
    all
}

/// Lines of a page outside fenced code, numbered from 1.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut in_code = false;
    text.lines().enumerate().filter_map(move |(i, line)| {
        let fence = line.trim_start().starts_with("```");
        in_code ^= fence;
        (!fence && !in_code).then_some((i + 1, line))
    })
}

fn headings(text: &str) -> impl Iterator<Item = &str> {
    prose(text).filter(|(_, line)| line.starts_with('#')).map(|(_, line)| line.trim_start_matches('#').trim())
}

/// Anchors of a page, as GitHub forms them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    headings(text)
        .map(|heading| {
            let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
            let slug: String =
                kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect();
            let count = seen.entry(slug.clone()).or_default();
            *count += 1;
            if *count == 1 { slug } else { format!("{slug}-{}", *count - 1) }
        })
        .collect()
}

/// A number such as `5` or `5.4` at the beginning of a text, and what follows it.
fn number(text: &str) -> Option<(&str, &str)> {
    let digits = |s: &str| s.find(|c: char| !c.is_ascii_digit()).unwrap_or(s.len());
    let mut end = digits(text);
    if end == 0 {
        return None;
    }
    while let Some(rest) = text[end..].strip_prefix('.').filter(|r| digits(r) > 0) {
        end += 1 + digits(rest);
    }
    Some((&text[..end], &text[end..]))
}

/// Numbers of the sections of a page.
fn sections(text: &str) -> BTreeSet<String> {
    let first = |heading: &str| heading.split(' ').next().map(str::to_owned);
    headings(text)
        .filter_map(first)
        .filter(|word| number(word).is_some_and(|(_, rest)| rest.is_empty()))
        .collect()
}

/// Numbers of a list such as `5.2 (factor), 1.4 to 1.9 and 2`.
fn list(mut text: &str) -> Vec<&str> {
    let mut all = Vec::new();
    while let Some((section, rest)) = number(text) {
        all.push(section);
        text = rest;
        if let Some(inside) = text.strip_prefix(" (") {
            let mut depth = 1;
            let closed = inside.find(|c| {
                depth += i32::from(c == '(') - i32::from(c == ')');
                depth == 0
            });
            let Some(closed) = closed else { break };
            text = &inside[closed + 1..];
        }
        let separators = [", ", " and ", " to "];
        let Some(rest) = separators.iter().find_map(|s| text.strip_prefix(s)) else { break };
        text = rest;
    }
    all
}

/// Sections of the equations that a line cites.
fn equations(line: &str) -> Vec<&str> {
    let short = line.split("equations ").skip(1);
    let long =
        line.split(EQUATIONS).skip(1).filter_map(|rest| rest.trim_start_matches('`').strip_prefix(' '));
    short.chain(long).flat_map(list).collect()
}

/// Pages of `docs` that a line names, each with the anchor or the section that it cites.
fn paths(line: &str) -> Vec<(String, Option<&str>, Option<&str>)> {
    let of_path = |c: char| c.is_ascii_alphanumeric() || "/-_.".contains(c);
    let mut all = Vec::new();
    for rest in line.split("docs/").skip(1) {
        let end = rest.find(|c| !of_path(c)).unwrap_or(rest.len());
        let Some(name) = rest[..end].find(".md").map(|at| &rest[..at + 3]) else { continue };
        let rest = &rest[name.len()..];
        let anchor = rest.strip_prefix('#').map(|a| &a[..a.find(|c| !of_path(c)).unwrap_or(a.len())]);
        let behind = rest.trim_start_matches('`');
        let section = behind.strip_prefix(", section ").or_else(|| behind.strip_prefix(' ')).and_then(number);
        all.push((format!("docs/{name}"), anchor, section.map(|(section, _)| section)));
    }
    all
}

/// Targets of the links of a line of a page; code in backticks has none.
fn links(line: &str) -> Vec<&str> {
    let mut all = Vec::new();
    let mut code = false;
    let mut rest = line;
    while let Some(at) = rest.find(['`', ']']) {
        let mark = rest.as_bytes()[at];
        rest = &rest[at + 1..];
        if mark == b'`' {
            code = !code;
        } else if let Some((target, behind)) =
            rest.strip_prefix('(').and_then(|r| r.split_once(')')).filter(|_| !code)
        {
            all.push(target);
            rest = behind;
        }
    }
    all
}

/// True where a file, or the head of a module above it, names the page of the equations.
fn names_the_page(path: &Path) -> bool {
    let names = |p: &Path| p.is_file() && read(p).contains(EQUATIONS);
    let above = path.ancestors().skip(1).take_while(|folder| folder.starts_with(root()));
    names(path) || above.into_iter().any(|f| names(&f.join("mod.rs")) || names(&f.join("lib.rs")))
}

/// Fails with all problems at once.
fn none(problems: &[String]) {
    assert!(problems.is_empty(), "{} problems:\n{}", problems.len(), problems.join("\n"));
}

#[test]
fn every_equation_that_is_cited_exists() {
    let mut pages = vec![root().join(EQUATIONS)];
    files(&root().join("docs/reference/equations"), "md", &mut pages);
    let known: BTreeSet<String> = pages.iter().flat_map(|p| sections(&read(p))).collect();
    let (mut cited, mut problems) = (0, Vec::new());
    for path in sources() {
        let text = read(&path);
        let mut cites = false;
        for (i, line) in text.lines().enumerate() {
            let place = || format!("{}:{}", path.display(), i + 1);
            let found = equations(line);
            cites |= !found.is_empty();
            cited += found.len();
            let missing = found.iter().filter(|section| !known.contains(**section));
            problems.extend(missing.map(|s| format!("{}: no section {s} in {EQUATIONS}", place())));
            if ["equations section", "contract section"].iter().any(|words| line.contains(words)) {
                problems.push(format!("{}: cite `equations N.M` or the path of a page", place()));
            }
        }
        if cites && !names_the_page(&path) {
            problems
                .push(format!("{}: name {EQUATIONS} here or in a mod.rs or lib.rs above", path.display()));
        }
    }
    none(&problems);
    assert!(cited >= CITATIONS_MIN, "only {cited} sections are cited");
}

#[test]
fn every_page_that_sources_name_exists() {
    let (mut named, mut problems) = (0, Vec::new());
    for path in sources() {
        for (i, line) in read(&path).lines().enumerate() {
            for (page, anchor, section) in paths(line) {
                named += 1;
                let place = format!("{}:{}", path.display(), i + 1);
                let file = root().join(&page);
                if !file.is_file() {
                    problems.push(format!("{place}: {page} does not exist"));
                    continue;
                }
                let text = read(&file);
                if anchor.is_some_and(|a| !anchors(&text).contains(a)) {
                    problems.push(format!("{place}: no heading {} in {page}", anchor.unwrap_or_default()));
                }
                // the equations have pages of their own
                if page != EQUATIONS && section.is_some_and(|s| !sections(&text).contains(s)) {
                    problems.push(format!("{place}: no section {} in {page}", section.unwrap_or_default()));
                }
            }
        }
    }
    none(&problems);
    assert!(named >= PATHS_MIN, "only {named} pages are named");
}

#[test]
fn every_relative_link_of_a_page_resolves() {
    let (mut count, mut problems) = (0, Vec::new());
    for page in pages() {
        let text = read(&page);
        for (line, words) in prose(&text) {
            for link in links(words) {
                if link.contains("://") || link.starts_with("mailto:") {
                    continue;
                }
                count += 1;
                let (file, anchor) = link.split_once('#').map_or((link, None), |(f, a)| (f, Some(a)));
                let target = if file.is_empty() { page.clone() } else { page.with_file_name(file) };
                let place = format!("{}:{line}", page.display());
                if !target.exists() {
                    problems.push(format!("{place}: {link} does not exist"));
                } else if anchor.is_some_and(|a| !anchors(&read(&target)).contains(a)) {
                    problems.push(format!("{place}: {link} has no such heading"));
                }
            }
        }
    }
    none(&problems);
    assert!(count >= LINKS_MIN, "only {count} links");
}

#[test]
fn the_table_of_contents_lists_every_page() {
    let docs = root().join("docs");
    let contents = docs.join("SUMMARY.md");
    let text = read(&contents);
    let listed: BTreeSet<PathBuf> =
        prose(&text).flat_map(|(_, words)| links(words)).map(|l| docs.join(l)).collect();
    let mut pages = Vec::new();
    files(&docs, "md", &mut pages);
    let missing = pages.iter().filter(|p| **p != contents && !listed.contains(*p));
    none(&missing.map(|p| format!("{} does not stand in docs/SUMMARY.md", p.display())).collect::<Vec<_>>());
    assert!(pages.len() > 40);
}

/// Longest page of `docs`, lines: what a reader still scans.
const PAGE_LINES: usize = 300;
/// Longest cell of a table, characters of prose: one sentence of about 25 words. Identifiers in backticks and targets of
/// links do not count.
const CELL_CHARS: usize = 160;

/// Characters of prose in a cell.
fn prose_chars(cell: &str) -> usize {
    let mut words = String::new();
    // what stands between backticks is code
    for (k, part) in cell.split('`').enumerate() {
        words.push_str(if k % 2 == 0 { part } else { "" });
    }
    for link in links(cell) {
        words = words.replacen(&format!("({link})"), "", 1);
    }
    words.trim().chars().filter(|c| !"[]".contains(*c)).count()
}

#[test]
fn pages_are_short_and_cells_hold_a_phrase() {
    let (mut cells, mut problems) = (0, Vec::new());
    let mut all = vec![root().join("README.md")];
    files(&root().join("docs"), "md", &mut all);
    for page in &all {
        let text = read(page);
        let lines = text.lines().count();
        if lines > PAGE_LINES {
            problems.push(format!("{}: {lines} lines, at most {PAGE_LINES}", page.display()));
        }
        for (line, words) in prose(&text).filter(|(_, words)| words.starts_with('|')) {
            for cell in words.replace("\\|", "").trim_matches('|').split('|') {
                cells += 1;
                let chars = prose_chars(cell);
                if chars > CELL_CHARS {
                    let place = format!("{}:{line}", page.display());
                    problems.push(format!("{place}: a cell of {chars} characters, at most {CELL_CHARS}"));
                }
            }
        }
    }
    none(&problems);
    assert!(cells > 3000, "only {cells} cells");
}

#[test]
fn files_in_the_table_of_names_exist() {
    let text = read(&root().join("docs/development/names.md"));
    let rows = text.lines().filter(|line| line.starts_with('|'));
    // the last cell has the names of today; files of the sources are given from the root on
    let cells = rows.filter_map(|row| row.trim_end_matches(" |").rsplit(" | ").next());
    let files: Vec<&str> = cells.flat_map(|c| c.split('`')).filter(|word| word.ends_with(".rs")).collect();
    assert!(files.len() > 60, "{}", files.len());
    none(&files.iter().filter(|f| !root().join(f).is_file()).map(|f| format!("no {f}")).collect::<Vec<_>>());
}

#[test]
fn citations_and_links_are_recognised() {
    assert_eq!(equations("/// # Source  equations 5.2, 1.4 (sense), 5.6 (a (b)); 7"), ["5.2", "1.4", "5.6"]);
    assert_eq!(equations("//! equations 1.4 to 1.9 and 2. Every"), ["1.4", "1.9", "2"]);
    assert_eq!(equations("//! see `docs/reference/equations.md` 3.2."), ["3.2"]);
    assert!(equations("//! the normal equations of 5 points").is_empty());
    let name = "docs/a/b.md".to_owned();
    assert_eq!(paths("(`docs/a/b.md`, section 6.2)"), [(name.clone(), None, Some("6.2"))]);
    assert_eq!(paths("docs/a/b.md#c-d)"), [(name.clone(), Some("c-d"), None)]);
    assert_eq!(paths("docs/a/b.md."), [(name, None, None)]);
    assert_eq!(links("[a](b.md#c), `[d](e)`, ![f](g.svg)"), ["b.md#c", "g.svg"]);
    assert_eq!(prose_chars(" a `long code` [b](c.md) d "), "a  b d".len());
    let page = "# 1 A `b`, c\n```\n# no\n```\n## 1.2 D-e_f\n## 1.2 D-e_f\n### x";
    assert_eq!(sections(page), BTreeSet::from(["1".to_owned(), "1.2".to_owned()]));
    let slugs = ["1-a-b-c", "12-d-e_f", "12-d-e_f-1", "x"].map(str::to_owned);
    assert_eq!(anchors(page), BTreeSet::from(slugs));
}
