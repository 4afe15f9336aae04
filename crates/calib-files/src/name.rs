use crate::Fingerprint;

/// Converts a name to a file name. Unusual characters are written as their codes, so that different names get
/// different files and no name leads to another folder. Letters keep their case, so names that differ only in case
/// still collide on file systems that ignore it. A name that would be too long for a file system ends in `~` and a
/// fingerprint of the name.
pub fn file_name(name: &str) -> String {
    let whole = encoded(name);
    if whole.len() <= LONGEST {
        return whole;
    }
    let fingerprint = Fingerprint::of(name.as_bytes());
    let digits = &fingerprint.as_str()[..DIGITS];
    format!("{}~{digits}", &whole[..LONGEST - DIGITS - 1])
}

/// Maximum bytes of an encoded name. Prefixes and suffixes, such as `learning-` and `.safetensors`, then fit into
/// the 255 of a file system as well.
const LONGEST: usize = 120;

/// Digits of the fingerprint of a truncated name.
const DIGITS: usize = 16;

/// Encodes the name in ASCII only, so that it can be cut anywhere.
fn encoded(name: &str) -> String {
    use std::fmt::Write as _;
    name.chars().enumerate().fold(String::new(), |mut file, (position, character)| {
        let usual = character.is_ascii_alphanumeric()
            || matches!(character, '_' | '-')
            || (character == '.' && position > 0);
        if usual {
            file.push(character);
        } else {
            // Writing to a string cannot fail.
            let _ = write!(file, "%{:x}%", u32::from(character));
        }
        file
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_names_fit_and_stay_apart() {
        let long = "温".repeat(40);
        let [one, other] = ["a", "b"].map(|end| file_name(&format!("{long}{end}")));
        assert_ne!(one, other);
        assert!(one.len() == LONGEST && other.len() == LONGEST, "{one}");
        assert_eq!(file_name(&"x".repeat(LONGEST)), "x".repeat(LONGEST));
        assert_ne!(file_name(&one), one, "`~` stands in no other name");
    }

    #[test]
    fn names_have_places_of_their_own() {
        assert_eq!(file_name("WELL-1.P_x"), "WELL-1.P_x");
        assert_ne!(file_name("a/b"), file_name("a_b"));
        assert_ne!(file_name("温度"), file_name("圧力"));
        assert!(!file_name("../x").starts_with('.') && !file_name("../x").contains('/'));
    }
}
