//! The named scenes, embedded.

macro_rules! scenes {
    ($($name:literal),* $(,)?) => {
        /// Names of the embedded scenes.
        pub const NAMES: &[&str] = &[$($name),*];

        pub(super) fn text(name: &str) -> Option<&'static str> {
            match name {
                $($name => Some(include_str!(concat!("../../scenes/", $name, ".toml"))),)*
                _ => None,
            }
        }
    };
}

scenes!(
    "wall",
    "tilted",
    "sphere",
    "corner",
    "stairs",
    "desk",
    "living-room",
    "corridor",
    "door",
    "facets-easy",
    "facets-medium",
    "facets-hard",
);
