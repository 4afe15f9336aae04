use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

macro_rules! index {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(
            Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
        )]
        #[serde(transparent)]
        pub struct $name(pub u32);

        impl $name {
            /// Returns the index of position `index`.
            ///
            /// # Panics
            /// If `index` does not fit in 32 bits; data of that many rows is refused on loading.
            pub fn new(index: usize) -> Self {
                Self(u32::try_from(index).expect("rows are counted in 32 bits"))
            }

            /// Returns the position that this index names.
            pub const fn get(self) -> usize {
                self.0 as usize
            }
        }
    };
}

index! {
    /// A row of [`Frames`](crate::Frames): one recorded state.
    RowIndex
}

index! {
    /// A transition of [`Transitions`](crate::Transitions): two successive rows of one segment.
    TransitionIndex
}
