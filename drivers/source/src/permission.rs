//! Who may open a device, and what to do when one may not: the group that owns it, and the udev line that opens it for good.
//!
//! A permission error that says "permission denied" sends its reader to a search engine. The device node knows its group, the USB device its
//! numbers; together they are two lines that can be copied.

use std::fmt::Write as _;
use std::path::Path;

/// A kind of device, by the kernel subsystem that owns its node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subsystem {
    /// `/dev/videoN`.
    Video4Linux,
    /// `/dev/bus/usb/BBB/DDD`.
    Usb,
    /// `/dev/iio:deviceN` and its sysfs files.
    Iio,
}

impl Subsystem {
    const fn name(self) -> &'static str {
        match self {
            Self::Video4Linux => "video4linux",
            Self::Usb => "usb",
            Self::Iio => "iio",
        }
    }

    /// The group that distributions give such nodes to.
    const fn usual_group(self) -> &'static str {
        match self {
            Self::Video4Linux => "video",
            Self::Usb | Self::Iio => "plugdev",
        }
    }
}

/// What to do so that this user may open `path`: the group to join, or the udev rule to add. `usb` is the device's vendor and product number,
/// when it has them. `group` is the owner's name, as [`group_of`] finds it.
///
/// ```
/// use isobath_source::permission::{Subsystem, hint};
/// let text = hint(Subsystem::Video4Linux, Some("video"), Some((0x8086, 0x0b07)));
/// assert!(text.contains("usermod -aG video") && text.contains(r#"ATTRS{idVendor}=="8086""#));
/// ```
#[must_use]
pub fn hint(subsystem: Subsystem, group: Option<&str>, usb: Option<(u16, u16)>) -> String {
    // A node of root's group is opened by no membership that one should take on.
    let group = group.filter(|&g| g != "root").unwrap_or(subsystem.usual_group());
    let mut text = format!(
        "join its group (sudo usermod -aG {group} $USER, then log in again), or put this line into /etc/udev/rules.d/60-isobath.rules, run sudo udevadm control --reload, and plug it in again: SUBSYSTEM==\"{}\"",
        subsystem.name()
    );
    if let Some((vendor, product)) = usb {
        // Nodes of the USB subsystem carry the numbers themselves, the others inherit them.
        let attribute = if subsystem == Subsystem::Usb { "ATTR" } else { "ATTRS" };
        let _ =
            write!(text, ", {attribute}{{idVendor}}==\"{vendor:04x}\", {attribute}{{idProduct}}==\"{product:04x}\"");
    }
    text.push_str(", MODE=\"0660\", TAG+=\"uaccess\"");
    text
}

/// The name of the group that owns a file; `None` when there is no such file or group.
#[must_use]
pub fn group_of(path: &Path) -> Option<String> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let gid = std::fs::metadata(path).ok()?.gid();
        let groups = std::fs::read_to_string("/etc/group").ok()?;
        group_named(&groups, gid).map(str::to_owned)
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        None
    }
}

/// The name of a group in the text of `/etc/group`.
#[cfg(unix)]
fn group_named(groups: &str, gid: u32) -> Option<&str> {
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(gid)).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_can_be_copied() {
        let text = hint(Subsystem::Usb, None, Some((0x045e, 0x02ae)));
        assert!(text.contains("usermod -aG plugdev $USER"), "{text}");
        assert!(
            text.ends_with(
                "SUBSYSTEM==\"usb\", ATTR{idVendor}==\"045e\", ATTR{idProduct}==\"02ae\", MODE=\"0660\", TAG+=\"uaccess\""
            ),
            "{text}"
        );
        let text = hint(Subsystem::Iio, Some("root"), None);
        assert!(text.contains("-aG plugdev") && text.contains("SUBSYSTEM==\"iio\", MODE"), "{text}");
    }

    #[cfg(unix)]
    #[test]
    fn groups_are_found_by_number() {
        let text = "root:x:0:\nbroken\nvideo:x:44:ann,bob\nalso:x:44:\n";
        assert_eq!(group_named(text, 44), Some("video"));
        assert_eq!((group_named(text, 0), group_named(text, 7)), (Some("root"), None));
        assert_eq!(group_of(Path::new("/no/such/file")), None);
    }
}
