//! What other renderers take to the same errors.
//!
//! Figures come from their own harness: as rows (CSV: scene, camera, peer, budget_s, seconds, rmse_tm,
//! reference_noise_tm; the same reduction to times as here), or as the table that it printed in an earlier run, which
//! is marked as such.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use surfelcast::Failure;
use surfelcast_measure::fit::{Reached, cost_to_error};

use crate::report::read_text;
use crate::studies::curves::{GOALS, reached};

/// Scene and camera, and the name of the peer.
type Key = (String, String, String);

/// Times of other renderers to each of [`GOALS`].
#[derive(Debug, Default)]
pub(super) struct Peers {
    /// In the order of the columns.
    pub(super) names: Vec<String>,
    times: BTreeMap<Key, [String; GOALS.len()]>,
}

/// One render of their harness.
#[derive(Debug, Deserialize)]
struct Row {
    scene: String,
    camera: String,
    peer: String,
    budget_s: String,
    seconds: f64,
    rmse_tm: f64,
    reference_noise_tm: f64,
}

/// Logarithms of seconds and squared errors by budget, to be averaged over renders.
type Renders = BTreeMap<String, Vec<[f64; 2]>>;

impl Peers {
    /// Reads all files; the first that has a figure counts.
    pub(super) fn read(files: &[PathBuf]) -> Result<Self, Failure> {
        let mut peers = Self::default();
        for file in files {
            let text = read_text(file)?;
            let is_rows = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
            if is_rows { peers.add_rows(&text, file)? } else { peers.add_tables(&text, file)? }
        }
        Ok(peers)
    }

    /// Times of a peer for a case with Lambertian materials.
    pub(super) fn times_of(&self, case: &str, peer: &str) -> Option<&[String; GOALS.len()]> {
        let is_it = |(scene, camera, name): &Key| name == peer && case == format!("{scene}_{camera}_lambert");
        self.times.iter().find(|(key, _)| is_it(key)).map(|(_, times)| times)
    }

    fn add(&mut self, key: Key, times: [String; GOALS.len()]) {
        if !self.names.contains(&key.2) {
            self.names.push(key.2.clone());
        }
        self.times.entry(key).or_insert(times);
    }

    pub(super) fn add_rows(&mut self, text: &str, file: &Path) -> Result<(), Failure> {
        let fault = |what: String| Failure::input(format!("--peers {}: {what}", file.display()));
        let mut groups: Vec<(Key, Renders)> = Vec::new();
        for row in csv::Reader::from_reader(text.as_bytes()).deserialize() {
            let row: Row = row.map_err(|error| fault(error.to_string()))?;
            let Row { seconds, rmse_tm, reference_noise_tm, .. } = row;
            if let Some(bad) = [seconds, rmse_tm, reference_noise_tm].iter().find(|value| !(**value >= 0.0)) {
                return Err(fault(format!("{bad} is not a number from 0")));
            }
            let key = (row.scene, row.camera, row.peer);
            let render = [seconds.max(1e-6).ln(), (rmse_tm.powi(2) - reference_noise_tm.powi(2)).max(1e-10)];
            let position = groups.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
                groups.push((key, Renders::new()));
                groups.len() - 1
            });
            groups[position].1.entry(row.budget_s).or_default().push(render);
        }
        if groups.is_empty() {
            return Err(fault("there is no row".to_owned()));
        }
        for (key, renders) in groups {
            let mut points: Vec<(f64, f64)> = renders
                .values()
                .map(|renders| {
                    let mean = |i: usize| renders.iter().map(|render| render[i]).sum::<f64>() / renders.len() as f64;
                    (mean(0).exp(), mean(1).sqrt())
                })
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let times = GOALS.map(|goal| match cost_to_error(&points, goal) {
                // Without a denoiser the error is noise, which falls with the root of the samples.
                Some(Reached::Not(secs)) if !key.2.contains("oidn") => {
                    let error = points.last().map_or(goal, |point| point.1);
                    format!("~{:.1}", secs * (error / goal).powi(2))
                }
                time => reached(time, 1.0),
            });
            self.add(key, times);
        }
        Ok(())
    }

    /// Finds the table whose rows are `| scene, camera (noise) | goal | peer | peer | ... |`.
    pub(super) fn add_tables(&mut self, text: &str, file: &Path) -> Result<(), Failure> {
        let cells = |line: &str| -> Vec<String> {
            line.trim().trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
        };
        let mut lines =
            text.lines().skip_while(|line| !(line.starts_with("| scene, camera") && line.contains("error")));
        let heads = cells(lines.next().ok_or_else(|| {
            Failure::input(format!("--peers {}: there is no table of seconds to errors", file.display()))
        })?);
        let mut place = (String::new(), String::new());
        let mut found: BTreeMap<Key, BTreeMap<usize, String>> = BTreeMap::new();
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
                self.add((scene.clone(), camera.clone(), peer.clone()), times);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(crate) const ROWS: &str = "scene,camera,peer,budget_s,seconds,rmse_tm,reference_noise_tm\n\
                        box,main,rays,1,1.0,0.05,0.03\nbox,main,rays,1,1.0,0.05,0.03\nbox,main,rays,4,4.0,0.036,0.03\n";
    pub(crate) const TABLE: &str = "# x\n| scene, camera (reference noise) | to error | rays | other |\n\
                         |---|---|---|---|\n\
                         | box, main (0.0013) | 0.03 | 9 | <0.25 |\n|  | 0.02 | 1.5 | |\n\
                         |  | 0.01 | ~7 | >4 |\n\ntext\n";

    #[test]
    fn rows_come_before_stated_figures() {
        let mut peers = Peers::default();
        peers.add_rows(ROWS, Path::new("rows.csv")).unwrap();
        peers.add_tables(TABLE, Path::new("table.md")).unwrap();
        assert_eq!(peers.names, ["rays", "other"]);
        // Without the noise the errors are 0.04 and 0.0199.
        assert_eq!(peers.times_of("box_main_lambert", "rays").unwrap(), &["1.77", "3.96", "~15.8"]);
        assert_eq!(peers.times_of("box_main_lambert", "other").unwrap(), &["<0.25*", "", ">4*"]);
    }

    #[test]
    fn other_files_are_refused() {
        let mut peers = Peers::default();
        let path = Path::new("x");
        assert!(matches!(peers.add_tables("nothing", path), Err(Failure::Input(_))));
        for bad in ["", "scene,camera\n", &ROWS.replace("0.05", "nan"), &ROWS.replace(",0.05,0.03", "")] {
            assert!(matches!(peers.add_rows(bad, path), Err(Failure::Input(_))), "{bad}");
        }
    }
}
