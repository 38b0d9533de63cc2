//! What can go wrong with a scene, its files, or what was asked of it: what, where, what to do.

use std::path::PathBuf;

/// Why a scene can't be simulated or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// No scene of this name, and no file.
    #[error("there is no scene {name:?}; named scenes are {}; or give the path of a scene file ending in .toml", crate::scene::NAMES.join(", "))]
    UnknownScene {
        /// What was asked for.
        name: String,
    },
    /// The scene's text is not a scene.
    #[error("{scene}: {what}")]
    Scene {
        /// Its name or path.
        scene: String,
        /// What is wrong, where, and what to do.
        what: String,
    },
    /// An option or a sensor's description is not usable.
    #[error("{what}")]
    Option {
        /// What is wrong, and what to do.
        what: String,
    },
    /// A file can't be read or written.
    #[error("{}: {error}; {hint}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        error: std::io::Error,
        /// What to do.
        hint: &'static str,
    },
    /// A file's content is broken.
    #[error("{}: {what}; {hint}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
        /// What to do.
        hint: &'static str,
    },
}

impl SimError {
    pub(crate) fn option(what: impl Into<String>) -> Self {
        Self::Option { what: what.into() }
    }

    pub(crate) fn read(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |error| Self::Io { path, error, hint: "check the path, and who may read it" }
    }
}
