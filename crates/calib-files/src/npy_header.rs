//! The header of a NumPy file. Parsing is as strict as NumPy's: a header that NumPy refuses is refused here too.
//!
//! After <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>: magic, version, length, and a Python
//! dictionary of exactly three keys.

/// Maximum number of dimensions of a NumPy array.
const MOST_DIMENSIONS: usize = 64;
/// Length of the longest header that NumPy loads.
const LONGEST: usize = 10_000;

/// The contents of a NumPy header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NpyHeader<'a> {
    /// NumPy's name of the number type: `<f8`.
    pub(crate) description: &'a str,
    /// Whether the first dimension is fastest.
    pub(crate) is_column_major: bool,
    /// Length of each dimension.
    pub(crate) shape: Vec<usize>,
    /// Offset of the data.
    pub(crate) data: usize,
}

impl<'a> NpyHeader<'a> {
    /// Parses the header of a file that begins with `bytes`.
    ///
    /// # Errors
    /// A description of the error.
    pub(crate) fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
            return Err("it does not begin as NumPy files do".to_owned());
        };
        let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(cut_off)?;
        let (length, rest) = match version {
            [1, 0] => {
                let (length, rest) = rest.split_first_chunk().ok_or_else(cut_off)?;
                (usize::from(u16::from_le_bytes(*length)), rest)
            }
            [2 | 3, 0] => {
                let (length, rest) = rest.split_first_chunk().ok_or_else(cut_off)?;
                (u32::from_le_bytes(*length) as usize, rest)
            }
            [major, minor] => {
                return Err(format!("expected format version 1.0 to 3.0, got {major}.{minor}"));
            }
        };
        let (header, after) = rest.split_at_checked(length).ok_or_else(cut_off)?;
        if length > LONGEST {
            return Err(format!("its header has {length} bytes, expected at most {LONGEST}"));
        }
        let text = std::str::from_utf8(header).map_err(|_| "the header is not text".to_owned())?;
        let mut header = Dictionary { rest: text }.header()?;
        header.data = bytes.len() - after.len();
        Ok(header)
    }

    /// Returns the bytes of the data for numbers of `size` bytes, or `None` on overflow.
    pub(crate) fn bytes(&self, size: usize) -> Option<usize> {
        self.shape.iter().try_fold(size, |product, &length| product.checked_mul(length))
    }
}

fn cut_off() -> String {
    "the header is cut off".to_owned()
}

fn lacks(key: &str) -> String {
    format!("the header has no {key:?}")
}

/// A parser of a Python dictionary literal.
struct Dictionary<'a> {
    rest: &'a str,
}

impl<'a> Dictionary<'a> {
    fn header(mut self) -> Result<NpyHeader<'a>, String> {
        let mut description = None;
        let mut is_column_major = None;
        let mut shape = None;
        self.expect("{")?;
        while !self.take("}") {
            let key = self.string()?;
            self.expect(":")?;
            let is_known = match key {
                "descr" => description.replace(self.string()?).is_some(),
                "fortran_order" => is_column_major.replace(self.truth()?).is_some(),
                "shape" => shape.replace(self.shape()?).is_some(),
                other => {
                    return Err(format!("the header has {other:?}, which NumPy does not know"));
                }
            };
            if is_known {
                return Err(format!("the header has two of {key:?}"));
            }
            if !self.take(",") {
                self.expect("}")?;
                break;
            }
        }
        if !self.rest.trim().is_empty() {
            return Err("the header goes on after its dictionary".to_owned());
        }
        Ok(NpyHeader {
            description: description.ok_or_else(|| lacks("descr"))?,
            is_column_major: is_column_major.ok_or_else(|| lacks("fortran_order"))?,
            shape: shape.ok_or_else(|| lacks("shape"))?,
            data: 0,
        })
    }

    fn take(&mut self, sign: &str) -> bool {
        self.rest = self.rest.trim_start();
        match self.rest.strip_prefix(sign) {
            Some(rest) => {
                self.rest = rest;
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, sign: &str) -> Result<(), String> {
        if self.take(sign) {
            Ok(())
        } else {
            Err(format!("expected {sign} in the header, got {}", self.shown()))
        }
    }

    /// Returns the next few characters.
    fn shown(&self) -> String {
        format!("{:?}", self.rest.chars().take(20).collect::<String>())
    }

    fn string(&mut self) -> Result<&'a str, String> {
        let quote = if self.take("'") {
            '\''
        } else if self.take("\"") {
            '"'
        } else {
            return Err(format!(
                "expected text in quotes in the header, as of arrays of real numbers, got {}",
                self.shown()
            ));
        };
        let (text, rest) =
            self.rest.split_once(quote).ok_or("a quote in the header is not closed")?;
        if text.contains(['\\', '\n']) {
            return Err("text in the header is not plain".to_owned());
        }
        self.rest = rest;
        Ok(text)
    }

    fn truth(&mut self) -> Result<bool, String> {
        let truth = self.take("True");
        if !truth {
            self.expect("False")?;
        }
        Ok(truth)
    }

    /// Parses a tuple of lengths. A single length has a comma after it.
    fn shape(&mut self) -> Result<Vec<usize>, String> {
        self.expect("(")?;
        let mut shape = Vec::new();
        while !self.take(")") {
            shape.push(self.length()?);
            if shape.len() > MOST_DIMENSIONS {
                return Err(format!(
                    "it has more than {MOST_DIMENSIONS} dimensions, the most that NumPy has"
                ));
            }
            if !self.take(",") {
                self.expect(")")?;
                if shape.len() == 1 {
                    let reason =
                        "the header has no usable shape: one length alone is written as (3,)";
                    return Err(reason.to_owned());
                }
                return Ok(shape);
            }
        }
        Ok(shape)
    }

    fn length(&mut self) -> Result<usize, String> {
        let text = self.rest.trim_start();
        let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
        let (digits, rest) = text.split_at(end);
        let plain = digits == "0" || !digits.starts_with('0');
        let length = digits.parse().ok().filter(|_| plain);
        let length =
            length.ok_or_else(|| format!("the header has no usable shape, at {}", self.shown()))?;
        self.rest = rest;
        Ok(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(header: &str) -> Result<NpyHeader<'static>, String> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        NpyHeader::parse(bytes.leak())
    }

    /// Returns the shape of a header with this text.
    fn read_shape(shape: &str) -> Result<Vec<usize>, String> {
        let header = format!("{{'descr':\"|u1\",'fortran_order':True,'shape':{shape}}}");
        parse(&header).map(|header| header.shape)
    }

    #[test]
    fn headers_of_numpy_are_read() {
        let usual = "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }      \n";
        let header = parse(usual).expect("valid");
        assert_eq!((header.description, header.is_column_major), ("<f8", false));
        assert_eq!((&header.shape[..], header.data), (&[2, 3][..], 10 + usual.len()));
        assert_eq!(header.bytes(8), Some(48));
        assert_eq!(read_shape("()"), Ok(vec![]));
        assert_eq!(read_shape("(3,)"), Ok(vec![3]));
        assert_eq!(read_shape(" ( 3 , 0 , ) "), Ok(vec![3, 0]));
        for refused in
            ["(3)", "3", "[3]", "(-3,)", "(03,)", "(3 4)", "(,)", "(3,,4)", "(3,", "(3.0,)"]
        {
            assert!(read_shape(refused).is_err(), "{refused}");
        }
        assert_eq!(read_shape(&format!("({})", "1,".repeat(64))).map(|shape| shape.len()), Ok(64));
        let many = read_shape(&format!("({})", "1,".repeat(65))).expect_err("too many");
        assert!(many.contains("more than 64 dimensions"), "{many}");
    }

    #[test]
    fn what_numpy_refuses_is_refused() {
        for (header, reason) in [
            ("{'descr': '<f8', 'fortran_order': False}", "no \"shape\""),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), 'x': 1}", "\"x\""),
            ("{'descr': '<f8', 'fortran_order': Falsely, 'shape': (2,)}", "expected }"),
            ("{'descr': '<f8', 'fortran_order': 0, 'shape': (2,)}", "expected False"),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (2,)} x", "goes on"),
            ("{'descr': '<f8', 'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", "two of"),
            ("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (2,)}", "real numbers"),
            ("'descr': '<f8', 'fortran_order': False, 'shape': (2,)", "expected {"),
            ("{'descr': '<f8, 'fortran_order': False, 'shape': (2,)}", "expected }"),
            ("{'descr': '<f8", "not closed"),
        ] {
            let error = parse(header).expect_err(header);
            assert!(error.contains(reason), "{header}: {error}");
        }
        let long = format!(
            "{{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}}{}",
            " ".repeat(10_000)
        );
        assert!(parse(&long).expect_err("too long").contains("at most 10000"));
        for version in [[0, 0], [1, 1], [4, 0]] {
            let bytes = [&b"\x93NUMPY"[..], &version, &[0; 9]].concat();
            assert!(
                NpyHeader::parse(&bytes).expect_err("unknown").contains("version"),
                "{version:?}"
            );
        }
        assert!(NpyHeader::parse(b"PAR1").is_err());
        assert!(
            NpyHeader::parse(b"\x93NUMPY\x01\x00\xff\xff{").expect_err("cut").contains("cut off")
        );
    }
}
