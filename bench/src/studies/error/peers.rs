//! What other renderers take to the same error, beside what we take.
//!
//! Their figures come from their own harness: as rows (CSV: scene, camera, peer, budget_s, seconds, rmse_tm,
//! reference_noise_tm; the same reduction to times as here), or as the table that it printed earlier, which was made in
//! another run and is marked so.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use surfelcast_measure::fit::{Reached, cost_to_error};

use crate::report::read_text;
use crate::studies::error::record::Curve;
use crate::studies::error::tables::{GOALS, by_case, conditions, reached};
use surfelcast::Failure;

/// Times of other renderers by (scene, camera) and peer, to each of [`GOALS`].
#[derive(Debug, Default)]
pub(super) struct Peers {
    /// In the order in which columns are shown.
    names: Vec<String>,
    times: BTreeMap<(String, String, String), [String; GOALS.len()]>,
}

/// Reads all files; the first that has a figure counts.
pub(super) fn read(files: &[PathBuf]) -> Result<Peers, Failure> {
    let mut peers = Peers::default();
    for file in files {
        let text = read_text(file)?;
        let is_rows = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
        if is_rows { peers.add_rows(&text, file)? } else { peers.add_tables(&text, file)? }
    }
    Ok(peers)
}

/// Logarithms of seconds and squared errors by budget, to be averaged over draws.
type Draws = BTreeMap<String, Vec<[f64; 2]>>;

impl Peers {
    fn add(&mut self, scene: &str, camera: &str, peer: &str, times: [String; GOALS.len()]) {
        if !self.names.iter().any(|name| name == peer) {
            self.names.push(peer.to_owned());
        }
        self.times.entry((scene.to_owned(), camera.to_owned(), peer.to_owned())).or_insert(times);
    }

    fn add_rows(&mut self, text: &str, file: &Path) -> Result<(), Failure> {
        let fault = |what: String| Failure::input(format!("--peers {}: {what}", file.display()));
        let mut lines = text.lines();
        let heads: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
        let column = |name: &str| {
            heads.iter().position(|head| *head == name).ok_or_else(|| fault(format!("there is no column {name}")))
        };
        let [scene, camera, peer, budget] = [column("scene")?, column("camera")?, column("peer")?, column("budget_s")?];
        let numbers = [column("seconds")?, column("rmse_tm")?, column("reference_noise_tm")?];
        let mut groups: Vec<([String; 3], Draws)> = Vec::new();
        for (number, line) in lines.enumerate() {
            let fields: Vec<&str> = line.split(',').collect();
            let field =
                |at: usize| fields.get(at).copied().ok_or_else(|| fault(format!("line {} is too short", number + 2)));
            let mut values = [0.0; 3];
            for (value, at) in values.iter_mut().zip(numbers) {
                let text = field(at)?;
                *value = text
                    .parse()
                    .ok()
                    .filter(|value: &f64| *value >= 0.0)
                    .ok_or_else(|| fault(format!("line {}: `{text}` is not a number from 0", number + 2)))?;
            }
            let [secs, measured, noise] = values;
            let key = [field(scene)?, field(camera)?, field(peer)?].map(str::to_owned);
            let draw = [secs.max(1e-6).ln(), (measured * measured - noise * noise).max(1e-10)];
            let position = groups.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
                groups.push((key, Draws::new()));
                groups.len() - 1
            });
            groups[position].1.entry(field(budget)?.to_owned()).or_default().push(draw);
        }
        for ([scene, camera, peer], draws) in groups {
            let mut points: Vec<(f64, f64)> = draws
                .values()
                .map(|draws| {
                    let mean = |i: usize| draws.iter().map(|draw| draw[i]).sum::<f64>() / draws.len() as f64;
                    (mean(0).exp(), mean(1).sqrt())
                })
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let times = GOALS.map(|goal| match cost_to_error(&points, goal) {
                // Noise falls with the root of the samples, and without a denoiser there is nothing else.
                Some(Reached::Not(secs)) if !peer.contains("oidn") => {
                    let error = points.last().map_or(goal, |point| point.1);
                    format!("~{:.1}", secs * (error / goal).powi(2))
                }
                time => reached(time, 1.0),
            });
            self.add(&scene, &camera, &peer, times);
        }
        Ok(())
    }

    /// Finds the table whose rows are `| scene, camera (noise) | goal | peer | peer | ... |`.
    fn add_tables(&mut self, text: &str, file: &Path) -> Result<(), Failure> {
        let cells = |line: &str| -> Vec<String> {
            line.trim().trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
        };
        let mut lines =
            text.lines().skip_while(|line| !(line.starts_with("| scene, camera") && line.contains("error")));
        let heads = cells(lines.next().ok_or_else(|| {
            Failure::input(format!("--peers {}: there is no table of seconds to errors", file.display()))
        })?);
        let mut place = (String::new(), String::new());
        let mut found: BTreeMap<(String, String, String), BTreeMap<usize, String>> = BTreeMap::new();
        for line in lines.skip(1).take_while(|line| line.starts_with('|')) {
            let row = cells(line);
            if let Some((scene, rest)) = row.first().and_then(|cell| cell.split_once(',')) {
                let camera = rest.split('(').next().unwrap_or_default().trim();
                place = (scene.to_owned(), camera.to_owned());
            }
            let goal = row.get(1).and_then(|cell| cell.parse::<f64>().ok());
            let Some(index) = goal.and_then(|goal| GOALS.iter().position(|known| (known - goal).abs() < 1e-9)) else {
                continue;
            };
            for (peer, time) in heads.iter().zip(&row).skip(2).filter(|(_, time)| !time.is_empty()) {
                let key = (place.0.clone(), place.1.clone(), peer.clone());
                found.entry(key).or_default().insert(index, format!("{time}*"));
            }
        }
        for head in heads.iter().skip(2) {
            for ((scene, camera, peer), times) in found.iter().filter(|((.., peer), _)| peer == head) {
                let times = [0, 1, 2].map(|index| times.get(&index).cloned().unwrap_or_default());
                self.add(scene, camera, peer, times);
            }
        }
        Ok(())
    }
}

/// Our seconds to each error beside theirs.
pub(super) fn table(curves: &[Curve], peers: &Peers) -> String {
    let mut ours: Vec<String> = Vec::new();
    for curve in curves {
        let label = curve.key.variant.label();
        if !ours.contains(&label) {
            ours.push(label);
        }
    }
    let mut text = conditions(curves);
    let heads = ours.iter().chain(&peers.names).cloned().collect::<Vec<_>>().join(" | ");
    let _ = writeln!(text, "| picture | RMSE | {heads} |\n|---|---|{}", "---|".repeat(ours.len() + peers.names.len()));
    for (case, of_case) in by_case(curves) {
        for (index, goal) in GOALS.iter().enumerate() {
            let mine = ours.iter().map(|label| {
                let curve = of_case.iter().find(|curve| curve.key.variant.label() == *label);
                reached(curve.and_then(|curve| curve.secs_to(*goal)), 1.0)
            });
            let theirs = peers.names.iter().map(|peer| {
                // Their figures hold for the picture of the reference, at its size.
                let is_same = of_case.iter().all(|curve| curve.key.truth == case);
                let is_it = |(scene, camera, name): &(String, String, String)| {
                    is_same && name == peer && case == format!("{scene}_{camera}_lambert")
                };
                let times = peers.times.iter().find(|(key, _)| is_it(key));
                times.map_or_else(|| "-".to_owned(), |(_, times)| times[index].clone())
            });
            let cells = mine.chain(theirs).collect::<Vec<_>>().join(" | ");
            let _ = writeln!(text, "| {} | {goal} | {cells} |", if index == 0 { case } else { "" });
        }
    }
    text += "\nSeconds of rendering, scene resident. `<`: the first picture was already there; `>`: not reached by the last; `~`: \
             extrapolated with slope -1/2.";
    if peers.times.values().flatten().any(|time| time.ends_with('*')) {
        text += " `*`: as their harness stated it in an earlier run, not beside ours.";
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::error::record::tests::curve;

    const ROWS: &str = "scene,camera,peer,budget_s,seconds,rmse_tm,reference_noise_tm\n\
                        box,main,rays,1,1.0,0.05,0.03\nbox,main,rays,1,1.0,0.05,0.03\nbox,main,rays,4,4.0,0.036,0.03\n";
    const TABLE: &str = "# x\n| scene, camera (reference noise) | to error | rays | other |\n|---|---|---|---|\n\
                         | box, main (0.0013) | 0.03 | 9 | <0.25 |\n|  | 0.02 | 1.5 | |\n|  | 0.01 | ~7 | >4 |\n\ntext\n";

    #[test]
    fn rows_come_before_stated_figures() {
        let mut peers = Peers::default();
        peers.add_rows(ROWS, Path::new("rows.csv")).unwrap();
        peers.add_tables(TABLE, Path::new("table.md")).unwrap();
        assert_eq!(peers.names, ["rays", "other"]);
        // Without the noise the errors are 0.04 and 0.0199.
        let mut curves = [curve("box_main_lambert", "path", 0.5)];
        assert!(!table(&curves, &peers).contains("1.77"), "another picture than theirs");
        curves[0].key.truth = "box_main_lambert".to_owned();
        let text = table(&curves, &peers);
        assert!(text.contains("| box_main_lambert | 0.03 | 5.56 | 1.77 | <0.25* |"), "{text}");
        assert!(text.contains("|  | 0.02 | 12.5 | 3.96 |  |"), "{text}");
        assert!(text.contains("|  | 0.01 | >32.0 | ~15.8 | >4* |"), "{text}");
    }

    #[test]
    fn what_is_no_such_file_is_refused() {
        let mut peers = Peers::default();
        let path = Path::new("x");
        assert!(matches!(peers.add_tables("nothing", path), Err(Failure::Input(_))));
        for bad in ["", "scene,camera\n", &ROWS.replace("0.05", "nan"), &ROWS.replace(",0.05,0.03", "")] {
            assert!(matches!(peers.add_rows(bad, path), Err(Failure::Input(_))), "{bad}");
        }
    }
}
