//! With which code and on which machine a number was measured.

use std::fmt::Write as _;
use std::process::Command;

use serde::{Deserialize, Serialize};
use surfelcast_gpu::Gpu;

/// What has to be stated with every number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Origin {
    /// Commit and its date, such as `c77d3d0 of 2026-11-27`.
    pub(crate) commit: String,
    /// Adapter, driver, processor and number of threads.
    pub(crate) device: String,
}

impl Origin {
    /// Of what this program measures now.
    pub(crate) fn of(gpu: &Gpu) -> Self {
        let info = gpu.info();
        let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let processor = processor();
        Self { commit: commit(), device: format!("{} ({}), {processor}, {threads} threads", info.name, info.driver) }
    }
}

/// The commit that is checked out, and whether files differ from it.
fn commit() -> String {
    let Some(commit) = git(&["log", "-1", "--format=%h of %cs"]) else { return "an unknown commit".to_owned() };
    let is_changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_none_or(|changes| !changes.is_empty());
    if is_changed { format!("{commit} with local changes") } else { commit }
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}

/// The processor's name, as Linux has it.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| "unknown processor".to_owned(), |(_, name)| name.trim().to_owned())
}

/// Options whose values are this machine's folders and files: they do not change what is measured.
const LOCAL_OPTIONS: [&str; 4] = ["--out", "--docs", "--peers", "--reference"];

/// The command line as another machine would type it.
fn command_line(words: impl Iterator<Item = String>) -> String {
    let mut text = "surfelcast-bench".to_owned();
    let mut is_value = false;
    for word in words.skip(1) {
        let is_local = LOCAL_OPTIONS.iter().any(|option| word == *option || word.starts_with(&format!("{option}=")));
        if !is_value && !is_local && word != "--reuse" {
            // Writing to a string cannot fail.
            let _ = if word.contains(' ') { write!(text, " \"{word}\"") } else { write!(text, " {word}") };
        }
        is_value = is_local && !word.contains('=');
    }
    text
}

/// The line above a table: what made it, when, where, and under which conditions.
pub(crate) fn describe<'a>(origins: impl Iterator<Item = &'a Origin>, conditions: &[String]) -> String {
    let (mut commits, mut devices): (Vec<&str>, Vec<&str>) = (Vec::new(), Vec::new());
    for origin in origins {
        for (known, one) in [(&mut commits, origin.commit.as_str()), (&mut devices, origin.device.as_str())] {
            if !known.contains(&one) {
                known.push(one);
            }
        }
    }
    let mut parts = vec![format!("Measured at {} on {}", commits.join(" and "), devices.join(" and on "))];
    parts.push(format!("`{}`", command_line(std::env::args())));
    parts.extend_from_slice(conditions);
    format!("{}.\n\n", parts.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_commit_is_named_once() {
        let origin = |commit: &str| Origin { commit: commit.to_owned(), device: "a device".to_owned() };
        let text = describe([origin("a1"), origin("b2"), origin("a1")].iter(), &["2 replicates".to_owned()]);
        assert!(
            text.starts_with("Measured at a1 and b2 on a device; `") && text.ends_with("`; 2 replicates.\n\n"),
            "{text}"
        );
    }

    #[test]
    fn folders_of_this_machine_are_left_out_of_the_command() {
        let words = ["/x/surfelcast-bench", "peers", "--out", "a", "--reuse", "--docs=b", "--scene", "living room"];
        let text = command_line(words.iter().map(|&word| word.to_owned()));
        assert_eq!(text, "surfelcast-bench peers --scene \"living room\"");
    }
}
