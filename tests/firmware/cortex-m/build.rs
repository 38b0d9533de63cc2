//! The memory map of the board that the target stands for.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

fn main() -> Result<(), Box<dyn Error>> {
    // mps2-an386: 4 MiB of flash and of RAM. mps3-an547: vectors in the instruction memory at 0, code in the 2 MiB of SRAM at 16
    // MiB (the hole between them is never loaded), data in the data memory.
    let map = if env::var("TARGET")?.starts_with("thumbv8m") {
        println!("cargo::rustc-cfg=armv8m");
        "MEMORY\n{\n  FLASH : ORIGIN = 0x00000000, LENGTH = 18M\n  RAM : ORIGIN = 0x20000000, LENGTH = 512K\n}\n_stext = 0x01000000;\n"
    } else {
        "MEMORY\n{\n  FLASH : ORIGIN = 0x00000000, LENGTH = 4M\n  RAM : ORIGIN = 0x20000000, LENGTH = 4M\n}\n"
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("no OUT_DIR")?);
    fs::write(out.join("memory.x"), map)?;
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg=-Tlink.x");
    println!("cargo::rustc-check-cfg=cfg(armv8m)");
    println!("cargo::rerun-if-changed=build.rs");
    Ok(())
}
