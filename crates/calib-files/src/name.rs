/// A name as a file name: everything unusual is written as its code, so that different names never share a
/// place and none leads elsewhere. Letters keep their case, so names that differ in case alone still collide
/// on file systems that ignore it.
pub fn file_name(name: &str) -> String {
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
    fn names_have_places_of_their_own() {
        assert_eq!(file_name("WELL-1.P_x"), "WELL-1.P_x");
        assert_ne!(file_name("a/b"), file_name("a_b"));
        assert_ne!(file_name("温度"), file_name("圧力"));
        assert!(!file_name("../x").starts_with('.') && !file_name("../x").contains('/'));
    }
}
