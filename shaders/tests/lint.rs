//! House rules for shader text beyond the checks of naga.

use std::collections::BTreeMap;

use surfelcast_shaders::{Module, kernels, modules};

/// Code without comments, by line number.
fn code(module: &Module) -> impl Iterator<Item = (usize, &str)> {
    module.text.lines().enumerate().map(|(index, line)| (index + 1, line.split("//").next().unwrap_or("")))
}

fn offences(rule: impl Fn(&Module, &str) -> bool) -> Vec<String> {
    let found = modules().flat_map(|module| {
        code(module).filter(|(_, line)| rule(module, line)).map(|(number, _)| format!("{}:{number}", module.file))
    });
    found.collect()
}

/// Whether `line` contains `word` as a whole word.
fn has_call(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        !before.is_some_and(|c| c.is_alphanumeric() || c == '_') && after == Some('(')
    })
}

#[test]
fn the_word_search_knows_names_from_parts_of_names() {
    assert!(has_call("let a = normalize(b);", "normalize"));
    assert!(!has_call("let a = normalize_or(b, c);", "normalize"));
    assert!(!has_call("let a = renormalize(b);", "normalize"));
}

#[test]
fn files_stay_readable() {
    for module in modules() {
        assert!(module.text.lines().count() <= 300, "{} is longer than 300 lines", module.file);
        assert!(module.text.starts_with("//"), "{} does not begin with a comment on its purpose", module.file);
        let wide = module.text.lines().position(|line| line.chars().count() > 200);
        assert!(wide.is_none(), "{}:{} is wider than 200 characters", module.file, wide.unwrap_or(0) + 1);
    }
}

/// `normalize` of a zero vector is NaN, which makes every mean NaN that it is added to.
#[test]
fn vectors_are_normalized_with_a_fallback() {
    assert_eq!(offences(|_, line| has_call(line, "normalize")), [""; 0], "use `normalize_or` of lib/core/math");
}

/// The linker separates module and name by a double underscore.
#[test]
fn names_have_no_double_underscore() {
    assert_eq!(offences(|_, line| line.contains("__")), [""; 0]);
}

/// Random numbers that depend on the order of execution differ between devices.
#[test]
fn nothing_counts_on_the_order_of_threads() {
    assert_eq!(offences(|_, line| has_call(line, "atomicAdd") && line.contains("let ")), [""; 0], "scan instead");
}

/// A library file that imports a technique would couple all techniques to it; `core` is below everything.
#[test]
fn imports_point_one_way() {
    let offences = offences(|module, line| {
        let Some(target) = line.split("import package::").nth(1) else { return false };
        (module.file.starts_with("lib/") && target.starts_with("techniques"))
            || (module.file.starts_with("lib/core/")
                && !target.starts_with("lib::core")
                && !target.starts_with("constants"))
    });
    assert_eq!(offences, [""; 0]);
}

/// A technique uses its own folder, `common` and the library.
#[test]
fn techniques_do_not_import_each_other() {
    let offences = offences(|module, line| {
        let Some(target) = line.split("import package::techniques::").nth(1) else { return false };
        let own = module.file.split('/').nth(1).unwrap_or("");
        let theirs = target.split("::").next().unwrap_or("");
        theirs != own && theirs != "common"
    });
    assert_eq!(offences, [""; 0]);
}

/// Files with entry points and files to import are told apart by folder.
#[test]
fn entry_points_are_in_kernel_files_and_nothing_imports_those() {
    for module in modules() {
        let is_kernel = kernels().iter().any(|kernel| kernel.file == module.file);
        let has_entry = code(module).any(|(_, line)| line.contains("@compute") || line.contains("@vertex"));
        assert_eq!(is_kernel, has_entry, "{}: entry points belong in techniques/<id>/kernels", module.file);
    }
    assert_eq!(offences(|_, line| line.contains("import package::") && line.contains("::kernels::")), [""; 0]);
}

#[test]
fn paths_stay_distinct_when_mangled() {
    let mut by_mangled: BTreeMap<String, &str> = BTreeMap::new();
    for module in modules() {
        if let Some(other) = by_mangled.insert(module.path.replace("::", "_"), &module.file) {
            panic!("{} and {} mangle alike", module.file, other);
        }
    }
    assert!(!kernels().is_empty());
}
