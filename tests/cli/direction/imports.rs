//! Which file of a crate imports from which, as far as the text shows.
//!
//! A file imports from another if a `use` or a path in it names an item that the other defines. Re-exports are
//! followed to the file that defines the item. A `mod` line is no import, nor is a re-export of a name that the file
//! itself does not use. Tests do not count.

use std::collections::{BTreeMap, BTreeSet};

/// The names of a module from the root of the crate.
type Module = Vec<String>;

/// A `use` of one name.
struct Import {
    path: Vec<String>,
    /// The name in this file, `*` for all names.
    name: String,
    is_public: bool,
}

/// What the imports of a file follow from.
#[derive(Default)]
struct Source {
    /// Path below the folder of the crate's sources.
    file: String,
    /// Items at the top of the file.
    defined: BTreeSet<String>,
    /// Modules that have files of their own.
    modules: Vec<String>,
    imports: Vec<Import>,
    /// Paths of two names or more outside of imports.
    paths: Vec<Vec<String>>,
    /// All names outside of imports.
    words: BTreeSet<String>,
}

/// The files of a crate.
pub(super) struct Sources {
    files: BTreeMap<Module, Source>,
}

/// A search for the file that defines an item, which asks no question twice.
struct Search<'s> {
    sources: &'s Sources,
    asked: BTreeSet<(Module, Vec<String>)>,
}

impl Sources {
    /// Reads files, each a path below the folder of the sources, with its text.
    pub(super) fn of(files: impl IntoIterator<Item = (String, String)>) -> Self {
        let mut all = BTreeMap::new();
        for (file, text) in files {
            let names = file.trim_end_matches(".rs").split('/').map(str::to_owned);
            let mut module: Module = names.collect();
            if module.last().is_some_and(|last| last == "mod" || last == "lib") {
                module.pop();
            }
            all.insert(module, Source::of(file, &text));
        }
        let mut declared = BTreeSet::from([Module::new()]);
        for (module, source) in &all {
            for child in &source.modules {
                declared.insert([module.as_slice(), std::slice::from_ref(child)].concat());
            }
        }
        // A file of tests is not declared outside of tests.
        all.retain(|module, _| (0..=module.len()).all(|end| declared.contains(&module[..end])));
        Self { files: all }
    }

    /// Returns each file with those that it imports from.
    pub(super) fn imports(&self) -> BTreeMap<String, BTreeSet<String>> {
        let mut graph = BTreeMap::new();
        for (module, source) in &self.files {
            let mut used = BTreeSet::new();
            for path in source.used() {
                let mut search = Search { sources: self, asked: BTreeSet::new() };
                used.extend(search.definer(module, &path).filter(|file| *file != source.file));
            }
            graph.insert(source.file.clone(), used);
        }
        graph
    }
}

impl Search<'_> {
    /// Returns the file that defines what a path in a module names.
    fn definer(&mut self, module: &[String], path: &[String]) -> Option<String> {
        match path.first()?.as_str() {
            "crate" => self.within(&[], &path[1..]),
            "self" => self.within(module, &path[1..]),
            "super" => {
                let ups = path.iter().take_while(|name| *name == "super").count();
                let above = module.len().checked_sub(ups)?;
                self.within(&module[..above], &path[ups..])
            }
            _ => self.within(module, path),
        }
    }

    /// Returns the file that defines what a path names that begins inside a module.
    fn within(&mut self, module: &[String], path: &[String]) -> Option<String> {
        let sources = self.sources;
        let source = sources.files.get(module)?;
        let name = path.first()?;
        if !self.asked.insert((module.to_vec(), path.to_vec())) {
            return None;
        }
        if source.defined.contains(name) {
            return Some(source.file.clone());
        }
        let child = [module, std::slice::from_ref(name)].concat();
        if sources.files.contains_key(&child) {
            return self.within(&child, &path[1..]);
        }
        let named = source.imports.iter().filter(|import| import.name == *name);
        for import in named.filter(|import| import.path[0] != *name) {
            let whole = [import.path.as_slice(), &path[1..]].concat();
            if let Some(found) = self.definer(module, &whole) {
                return Some(found);
            }
        }
        for import in source.imports.iter().filter(|import| import.name == "*") {
            let first = &import.path[0];
            let is_ours = ["crate", "self", "super"].contains(&first.as_str())
                || source.modules.contains(first);
            let whole = [&import.path[..import.path.len() - 1], path].concat();
            if let Some(found) = is_ours.then(|| self.definer(module, &whole)).flatten() {
                return Some(found);
            }
        }
        None
    }
}

impl Source {
    fn of(file: String, text: &str) -> Self {
        let tokens = without_tests(&tokens(text));
        let mut source = Self { file, ..Self::default() };
        let mut rest = Vec::new();
        let mut place = 0;
        while place < tokens.len() {
            let captures = tokens.get(place + 1) == Some(&"<");
            if tokens[place] == "use" && !captures {
                let is_public = is_public(&tokens[..place]);
                let end = tokens[place..].iter().position(|token| *token == ";");
                let end = end.map_or(tokens.len(), |length| place + length);
                let mut found = Vec::new();
                imported(&tokens[place + 1..end], &[], &mut found);
                for (path, name) in found {
                    source.imports.push(Import { path, name, is_public });
                }
                place = end;
            } else {
                rest.push(tokens[place]);
            }
            place += 1;
        }
        source.read_items(&rest);
        source.read_paths(&rest);
        source
    }

    /// Reads the names of the items at the top of a file.
    fn read_items(&mut self, tokens: &[&str]) {
        const KINDS: [&str; 9] =
            ["struct", "enum", "trait", "fn", "const", "static", "type", "union", "mod"];
        let mut depth = 0_usize;
        for (place, token) in tokens.iter().enumerate() {
            match *token {
                "{" | "(" | "[" => depth += 1,
                "}" | ")" | "]" => depth = depth.saturating_sub(1),
                "macro_rules" if depth == 0 => {
                    let name = tokens.get(place + 2).copied().unwrap_or_default();
                    self.defined.insert(name.to_owned());
                }
                kind if depth == 0 && KINDS.contains(&kind) => {
                    let name = tokens.get(place + 1).copied().unwrap_or_default();
                    if kind == "mod" && tokens.get(place + 2) == Some(&";") {
                        self.modules.push(name.to_owned());
                    } else if is_name(name) && !["fn", "unsafe", "mut"].contains(&name) {
                        self.defined.insert(name.to_owned());
                    }
                }
                _ => {}
            }
        }
    }

    fn read_paths(&mut self, tokens: &[&str]) {
        let mut place = 0;
        while place < tokens.len() {
            if !is_name(tokens[place]) {
                place += 1;
                continue;
            }
            let before = place.checked_sub(1).map(|before| tokens[before]);
            let mut path = vec![tokens[place].to_owned()];
            while tokens.get(place + 1) == Some(&"::")
                && tokens.get(place + 2).is_some_and(|name| is_name(name))
            {
                place += 2;
                path.push(tokens[place].to_owned());
            }
            place += 1;
            if before != Some("mod") || tokens.get(place) != Some(&";") {
                self.words.extend(path.iter().cloned());
            }
            // What follows a type in angle brackets is no path of its own.
            if path.len() > 1 && before != Some("::") {
                self.paths.push(path);
            }
        }
    }

    /// Returns the paths of the items that this file uses.
    fn used(&self) -> BTreeSet<Vec<String>> {
        let mut used: BTreeSet<Vec<String>> = self.paths.iter().cloned().collect();
        for Import { path, name, is_public } in &self.imports {
            if name != "*" {
                if !is_public || self.words.contains(name) {
                    used.insert(path.clone());
                }
            } else if !is_public {
                let module = &path[..path.len() - 1];
                for word in self.words.difference(&self.defined) {
                    used.insert([module, std::slice::from_ref(word)].concat());
                }
            }
        }
        used
    }
}

/// Whether the tokens before an item make it visible to others.
fn is_public(before: &[&str]) -> bool {
    matches!(before, [.., "pub"] | [.., "pub", "(", _, ")"])
}

/// Collects the paths and names of a `use`, given without its keyword and semicolon.
fn imported(tokens: &[&str], before: &[String], found: &mut Vec<(Vec<String>, String)>) {
    let mut path = before.to_vec();
    let mut name = None;
    let mut place = 0;
    while place < tokens.len() {
        match tokens[place] {
            "{" => {
                let inside = &tokens[place + 1..tokens.len() - 1];
                for part in parts(inside) {
                    imported(part, &path, found);
                }
                return;
            }
            "as" => {
                name = tokens.get(place + 1).map(|token| (*token).to_owned());
                break;
            }
            token if token == "::" || token == "self" && !path.is_empty() => {}
            token => path.push(token.to_owned()),
        }
        place += 1;
    }
    if let Some(last) = path.last() {
        let name = name.unwrap_or_else(|| last.clone());
        found.push((path, name));
    }
}

/// Splits a list of imports at its commas, but not inside of inner lists.
fn parts<'t, 's>(tokens: &'t [&'s str]) -> Vec<&'t [&'s str]> {
    let mut depth = 0;
    let parts = tokens.split(|token| {
        match *token {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ => {}
        }
        depth == 0 && *token == ","
    });
    parts.filter(|part| !part.is_empty()).collect()
}

fn is_name(token: &str) -> bool {
    token.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
}

/// Leaves out the items that are compiled for tests alone.
fn without_tests<'t>(tokens: &[&'t str]) -> Vec<&'t str> {
    let mut kept = Vec::with_capacity(tokens.len());
    let mut place = 0;
    while place < tokens.len() {
        let rest = &tokens[place..];
        if !rest.starts_with(&["#", "[", "cfg", "(", "test"])
            && !rest.starts_with(&["#", "[", "cfg", "(", "all", "(", "test"])
        {
            kept.push(tokens[place]);
            place += 1;
            continue;
        }
        let mut depth = 0_usize;
        for token in rest {
            place += 1;
            match *token {
                "{" | "(" | "[" => depth += 1,
                "}" | ")" | "]" => {
                    depth = depth.saturating_sub(1);
                    if depth == 0 && *token == "}" {
                        break;
                    }
                }
                ";" if depth == 0 => break,
                _ => {}
            }
        }
    }
    kept
}

/// Returns the names and signs of a file, without comments, strings, characters and lifetimes.
fn tokens(text: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if let Some(length) = raw_string(rest) {
            length
        } else if first == '"' {
            string(rest)
        } else if first == '\'' {
            character(rest)
        } else if is_name(rest) || first.is_ascii_digit() {
            let length = rest.find(ends_name).unwrap_or(rest.len());
            tokens.push(&rest[..length]);
            length
        } else if rest.starts_with("::") {
            tokens.push("::");
            2
        } else {
            if first.is_ascii_punctuation() {
                tokens.push(&rest[..1]);
            }
            first.len_utf8()
        };
        rest = &rest[length..];
    }
    tokens
}

/// Returns the length of the raw string that a text begins with, if it does.
fn raw_string(text: &str) -> Option<usize> {
    let after = text.strip_prefix("br").or_else(|| text.strip_prefix('r'))?;
    let hashes = after.len() - after.trim_start_matches('#').len();
    let content = after[hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    let length = content.find(&end).map_or(content.len(), |place| place + end.len());
    Some(text.len() - content.len() + length)
}

/// Returns the length of the string that a text begins with.
fn string(text: &str) -> usize {
    let mut is_escaped = false;
    for (place, letter) in text.char_indices().skip(1) {
        match letter {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return place + 1,
            _ => {}
        }
    }
    text.len()
}

fn ends_name(letter: char) -> bool {
    !letter.is_ascii_alphanumeric() && letter != '_'
}

/// Returns the length of the character or the lifetime that a text begins with.
fn character(text: &str) -> usize {
    let mut letters = text.char_indices().skip(1);
    match letters.next() {
        // The letter after the backslash may be a quotation mark.
        Some((_, '\\')) => text[3..].find('\'').map_or(text.len(), |end| end + 4),
        Some((_, letter)) if text[1 + letter.len_utf8()..].starts_with('\'') => {
            letter.len_utf8() + 2
        }
        _ => text[1..].find(ends_name).map_or(text.len(), |end| end + 1),
    }
}
