//! Dependencies go in one direction: between crates, and between the files of a crate.

mod imports;

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use imports::Sources;

/// Maps each name to the names that it uses.
type Graph = BTreeMap<String, BTreeSet<String>>;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns all Rust files below a folder.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
    found
}

/// Returns a cycle, if there is one: each uses the next, and the last uses the first.
fn circle(graph: &Graph) -> Option<Vec<String>> {
    fn from(
        graph: &Graph,
        path: &mut Vec<String>,
        done: &mut BTreeSet<String>,
    ) -> Option<Vec<String>> {
        let here = path.last()?.clone();
        for next in graph.get(&here).into_iter().flatten() {
            if let Some(start) = path.iter().position(|name| name == next) {
                return Some(path[start..].to_vec());
            }
            if !done.contains(next) {
                path.push(next.clone());
                if let Some(found) = from(graph, path, done) {
                    return Some(found);
                }
                path.pop();
            }
        }
        done.insert(here);
        None
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|start| from(graph, &mut vec![start.clone()], &mut done))
}

/// Returns the crates of the workspace, each with those that it is built from.
fn crates() -> Graph {
    let mut graph = Graph::new();
    for entry in fs::read_dir(root().join("crates")).expect("crates").flatten() {
        let name = entry.file_name().into_string().expect("a name");
        let manifest = read(&entry.path().join("Cargo.toml"));
        let (_, own) = manifest.split_once("[dependencies]").expect("dependencies");
        let own = own.split("\n[dev-dependencies]").next().unwrap_or(own);
        let used = own.lines().filter_map(|line| line.split(['.', ' ']).next());
        let used = used.filter(|name| name.starts_with("calib-")).map(str::to_owned);
        graph.insert(name, used.collect());
    }
    graph
}

#[test]
fn a_circle_is_found() {
    assert_eq!(circle(&graph_of(&[("a", "b"), ("b", "c"), ("a", "c")])), None);
    let around = circle(&graph_of(&[("a", "b"), ("b", "c"), ("c", "b")])).expect("b → c → b");
    assert_eq!(around, ["b", "c"]);
}

fn graph_of(edges: &[(&str, &str)]) -> Graph {
    let mut graph = Graph::new();
    for (from, to) in edges {
        graph.entry((*from).to_owned()).or_default().insert((*to).to_owned());
    }
    graph
}

/// Crates that contain the steps. Each may use those before it.
const STEPS: [&str; 4] = ["calib-base", "calib-model-steps", "calib-sweep-steps", "calib-pipeline"];

/// Returns the folder of sources of each package.
fn packages() -> Vec<(String, PathBuf)> {
    let mut packages: Vec<(String, PathBuf)> = crates()
        .into_keys()
        .map(|name| {
            let folder = root().join("crates").join(&name).join("src");
            (name, folder)
        })
        .collect();
    packages.push(("calib".to_owned(), root().join("src")));
    packages.push(("calib-python".to_owned(), root().join("python/src")));
    packages
}

/// Reads the sources of a package.
fn sources_below(folder: &Path) -> Sources {
    Sources::of(sources(folder).into_iter().map(|path| {
        let below = path.strip_prefix(folder).expect("inside");
        let names: Vec<_> = below.iter().map(|name| name.to_string_lossy()).collect();
        (names.join("/"), read(&path))
    }))
}

/// Returns all that a name uses, also through others.
fn reachable<'g>(graph: &'g Graph, start: &str) -> BTreeSet<&'g String> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&String> = graph[start].iter().collect();
    while let Some(next) = open.pop() {
        if reached.insert(next) {
            open.extend(&graph[next]);
        }
    }
    reached
}

/// Returns the sets of names that use each other, also through others.
fn circles(graph: &Graph) -> Vec<BTreeSet<&String>> {
    let reached: BTreeMap<&String, BTreeSet<&String>> =
        graph.keys().map(|start| (start, reachable(graph, start))).collect();
    let mut found = Vec::new();
    for start in graph.keys() {
        let around: BTreeSet<&String> = reached[start]
            .iter()
            .copied()
            .filter(|other| reached[*other].contains(start))
            .collect();
        if around.len() > 1 && !found.contains(&around) {
            found.push(around);
        }
    }
    found
}

#[test]
fn imports_are_followed_to_the_file_that_defines_an_item() {
    let files = [
        ("lib.rs", "mod a;\nmod b;\npub mod c;\npub use a::A;\nuse b::{B as Other, make};"),
        ("a.rs", "use crate::c::{self, Inner};\npub struct A(c::Inner, Inner);"),
        (
            "b.rs",
            "//! Like [`crate::A`].\npub struct B;\nfn make() -> &'static str { \"crate::A\" }",
        ),
        (
            "c/mod.rs",
            "mod inner;\npub use inner::Inner;\n#[cfg(test)]\nmod tests { use crate::A; }",
        ),
        ("c/inner.rs", "pub struct Inner;\nimpl Inner { fn is(all: crate::A) -> char { '\"' } }"),
        ("c/tests.rs", "use super::*;"),
    ];
    let files = files.map(|(file, text)| (file.to_owned(), text.to_owned()));
    let graph = Sources::of(files).imports();
    let expected = [("a.rs", "c/inner.rs"), ("c/inner.rs", "a.rs"), ("lib.rs", "b.rs")];
    let mut expected = graph_of(&expected);
    expected.extend(["b.rs", "c/mod.rs"].map(|file| (file.to_owned(), BTreeSet::new())));
    assert_eq!(graph, expected);
    let found = circles(&graph);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].iter().eq(&["a.rs", "c/inner.rs"]), "{found:?}");
}

#[test]
fn files_import_from_one_another_in_one_direction() {
    let mut found = Vec::new();
    for (package, folder) in packages() {
        let graph = sources_below(&folder).imports();
        assert!(!graph.is_empty(), "{package}");
        for circle in circles(&graph) {
            for file in &circle {
                let used = graph[*file].iter().filter(|used| circle.contains(used));
                found.extend(used.map(|used| format!("{package}: {file} imports from {used}")));
            }
        }
    }
    assert!(
        found.is_empty(),
        "files import from each other; move what they share into a file below them:\n{}",
        found.join("\n")
    );
}

#[test]
fn crates_have_no_circles_and_the_low_ones_know_nobody() {
    let graph = crates();
    assert!(graph.len() > 15, "{graph:?}");
    assert_eq!(circle(&graph), None);
    for lonely in ["calib-stats", "calib-dtw"] {
        assert!(graph[lonely].is_empty(), "{lonely} uses {:?}", graph[lonely]);
    }
    for (name, used) in &graph {
        let pipeline = used.contains("calib-pipeline");
        assert!(!pipeline, "{name} uses the pipeline, which only what runs a study does");
        let steps = STEPS.iter().position(|step| step == name).unwrap_or(0);
        let above = STEPS[steps..].iter().find(|step| used.contains(**step));
        assert_eq!(above, None, "{name} is below it, or no crate of steps");
    }
}

/// Draws the crates: an arrow to each dependency, except for those that are implied by another dependency.
fn picture() -> String {
    let mut graph = crates();
    let (_, own) = read(&root().join("Cargo.toml"))
        .rsplit_once("\n[dependencies]\n")
        .map(|(before, own)| (before.to_owned(), own.to_owned()))
        .expect("dependencies");
    let own = own.split("\n[").next().unwrap_or_default();
    let used = own.lines().filter_map(|line| line.split(['.', ' ']).next());
    let used = used.filter(|name| name.starts_with("calib-")).map(str::to_owned);
    graph.insert("calib".to_owned(), used.collect());
    let mut lines = vec!["```mermaid".to_owned(), "graph TD".to_owned()];
    for (name, used) in &graph {
        let direct = used
            .iter()
            .filter(|one| !used.iter().any(|other| other != *one && reaches(&graph, other, one)));
        lines.extend(direct.map(|one| format!("    {} --> {}", short(name), short(one))));
    }
    lines.push("```".to_owned());
    lines.join("\n")
}

fn short(name: &str) -> &str {
    name.strip_prefix("calib-").unwrap_or(name)
}

fn reaches(graph: &Graph, from: &str, to: &str) -> bool {
    graph.get(from).into_iter().flatten().any(|next| next == to || reaches(graph, next, to))
}

#[test]
fn the_picture_of_the_crates_is_true() {
    let told = read(&root().join("ARCHITECTURE.md"));
    assert!(
        told.contains(&picture()),
        "`cargo test --release --test cli draw_the_crates -- --ignored` draws it anew"
    );
}

#[test]
#[ignore = "writes ARCHITECTURE.md"]
fn draw_the_crates() {
    let path = root().join("ARCHITECTURE.md");
    let told = read(&path);
    let (before, rest) = told.split_once("```mermaid").expect("a picture");
    let (_, after) = rest.split_once("```").expect("its end");
    fs::write(&path, format!("{before}{}{after}", picture())).expect("writable");
}

#[test]
fn a_heavy_dependency_has_one_package() {
    let owners = [
        ("polars", "calib-data"),
        ("polars-core", "calib-data"),
        ("polars-io", "calib-data"),
        ("kiddo", "calib-knn"),
        ("gemm", "calib-nn"),
        ("tch", "calib-torch"),
    ];
    let mut manifests = vec![(String::from("calib"), read(&root().join("Cargo.toml")))];
    for name in crates().into_keys() {
        let text = read(&root().join("crates").join(&name).join("Cargo.toml"));
        manifests.push((name, text));
    }
    for (name, text) in &manifests {
        let (_, own) = text.rsplit_once("\n[dependencies]").expect("dependencies");
        let own = own.split("\n[dev-dependencies]").next().unwrap_or(own);
        for (heavy, owner) in owners {
            let names_it = own.lines().any(|line| {
                line.starts_with(&format!("{heavy}.")) || line.starts_with(&format!("{heavy} "))
            });
            assert!(!names_it || name == owner, "{name} names {heavy}, which is {owner}'s");
        }
    }
}

#[test]
fn no_function_is_longer_than_a_screen_and_a_half() {
    const LONGEST: usize = 80;
    let folders = [root().join("src"), root().join("crates")];
    let files = folders.iter().flat_map(|folder| sources(folder));
    let files = files.filter(|path| path.iter().any(|part| part == "src"));
    let mut long = Vec::new();
    for path in files {
        let text = read(&path);
        let mut begun: Option<(usize, usize)> = None;
        for (number, line) in text.lines().enumerate() {
            let indent = line.len() - line.trim_start().len();
            let begins = line.trim_start().split(' ').take(4).any(|word| word == "fn");
            if begun.is_none() && begins && !line.trim_end().ends_with(';') {
                begun = Some((number, indent));
            } else if let Some((start, outer)) = begun
                && indent == outer
                && line.trim_start().starts_with(['}', ')'])
            {
                // The arguments end here, and a trait function may have no body.
                if line.trim_start().starts_with(')') {
                    begun = begun.filter(|_| !line.trim_end().ends_with(';'));
                    continue;
                }
                if number - start + 1 > LONGEST {
                    long.push(format!("{}:{}: {}", path.display(), start + 1, number - start + 1));
                }
                begun = None;
            }
        }
    }
    assert!(long.is_empty(), "longer than {LONGEST} lines:\n{}", long.join("\n"));
}
