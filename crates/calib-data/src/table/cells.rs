use calib_core::Timestamp;

/// The values of one column.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells<T> {
    /// A column without missing values.
    Full(Vec<T>),
    /// A column in which values may be missing.
    Optional(Vec<Option<T>>),
}

impl<T> Cells<T> {
    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        match self {
            Self::Full(values) => values.len(),
            Self::Optional(values) => values.len(),
        }
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Collects values into [`Cells::Full`] if no value is missing.
    pub(crate) fn collect(values: impl Iterator<Item = Option<T>>, missing: usize) -> Self {
        if missing == 0 {
            let mut full = Vec::with_capacity(values.size_hint().0);
            full.extend(values.flatten());
            Self::Full(full)
        } else {
            Self::Optional(values.collect())
        }
    }

    /// Returns the values as `f64`, NaN for missing ones.
    fn numbers(&self, number: impl Fn(&T) -> f64) -> Vec<f64> {
        match self {
            Self::Full(values) => values.iter().map(number).collect(),
            Self::Optional(values) => {
                values.iter().map(|value| value.as_ref().map_or(f64::NAN, &number)).collect()
            }
        }
    }
}

/// A type that a column can hold.
pub trait Cell: Clone {
    /// Name of the type in messages.
    const NAME: &'static str;

    /// Wraps cells of this type as a column of any type.
    fn wrap(cells: Cells<Self>) -> Values;

    /// Returns the cells, if the column has this type.
    fn unwrap(values: &Values) -> Option<&Cells<Self>>;
}

macro_rules! values {
    ($($(#[$doc:meta])* $variant:ident($cell:ty, $name:literal)),+ $(,)?) => {
        /// A column of one of the types that tables hold.
        #[derive(Clone, Debug, PartialEq)]
        pub enum Values {
            $($(#[$doc])* $variant(Cells<$cell>)),+
        }

        impl Values {
            /// Returns the number of rows.
            pub fn len(&self) -> usize {
                match self {
                    $(Self::$variant(cells) => cells.len()),+
                }
            }

            /// Returns the name of the type in messages.
            pub fn type_name(&self) -> &'static str {
                match self {
                    $(Self::$variant(_) => $name),+
                }
            }
        }

        $(impl Cell for $cell {
            const NAME: &'static str = $name;

            fn wrap(cells: Cells<Self>) -> Values {
                Values::$variant(cells)
            }

            fn unwrap(values: &Values) -> Option<&Cells<Self>> {
                match values {
                    Values::$variant(cells) => Some(cells),
                    _ => None,
                }
            }
        })+
    };
}

values! {
    /// 64-bit floating point.
    Float64(f64, "f64"),
    /// 32-bit floating point.
    Float32(f32, "f32"),
    /// Counts and indices.
    UInt32(u32, "u32"),
    /// Large counts and seeds.
    UInt64(u64, "u64"),
    /// Signed numbers.
    Int64(i64, "i64"),
    /// Booleans.
    Bool(bool, "bool"),
    /// Text.
    Text(String, "text"),
    /// Instants, in microseconds.
    Time(Timestamp, "timestamp"),
}

impl Values {
    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the values as `f64`, NaN for missing ones; `None` for text and timestamps.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        Some(match self {
            Self::Float64(cells) => cells.numbers(|&value| value),
            Self::Float32(cells) => cells.numbers(|&value| f64::from(value)),
            Self::UInt32(cells) => cells.numbers(|&value| f64::from(value)),
            Self::UInt64(cells) => cells.numbers(|&value| value as f64),
            Self::Int64(cells) => cells.numbers(|&value| value as f64),
            Self::Bool(cells) => cells.numbers(|&value| f64::from(u8::from(value))),
            Self::Text(_) | Self::Time(_) => return None,
        })
    }
}
