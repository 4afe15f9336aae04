//! What the user gave with `--set`.

use calib_base::options::ProposeOptions;

/// Whether `key` was given with `--set`.
pub(super) fn gives(args: &ProposeOptions, key: &str) -> bool {
    given(args, key).is_some()
}

/// Returns the value that `--set` gives a key, as it was typed.
pub(super) fn given<'a>(args: &'a ProposeOptions, key: &str) -> Option<&'a str> {
    let pairs = args.set.iter().filter_map(|one| one.split_once('='));
    pairs.filter(|(name, _)| name.trim() == key).map(|(_, value)| value.trim()).next_back()
}

/// Whether `key` was given with `--set`, or a key of the table `key`.
pub(super) fn gives_any(args: &ProposeOptions, key: &str) -> bool {
    let keys = args.set.iter().filter_map(|one| Some(one.split_once('=')?.0.trim()));
    keys.filter_map(|given| given.strip_prefix(key))
        .any(|rest| rest.is_empty() || rest.starts_with('.'))
}
