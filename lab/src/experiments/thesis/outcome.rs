//! Result of an experiment (findings, tables, pictures, files), and the report of several.

use glam::DVec3;

use super::Experiment;
use radar_chaperone::report::{
    Figure, Picture, Report, ReportError, Section, Table, VolumeInfo, ply_bytes, volume_bytes,
};
use radar_sar::{Statistic, Volume};

/// A finding of the thesis and our figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The thesis' statement, in a sentence.
    pub thesis: String,
    /// Our figures.
    pub ours: String,
    /// Whether the figures confirm it; `None`: not tested.
    pub holds: Option<bool>,
}

impl Finding {
    /// The verdict as text.
    pub fn verdict(&self) -> &'static str {
        match self.holds {
            Some(true) => "holds",
            Some(false) => "does not hold",
            None => "not tested here",
        }
    }
}

/// A picture with its file name, without extension, and its caption.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPicture {
    /// Name of the file.
    pub name: String,
    /// The picture.
    pub picture: Picture,
    /// Caption.
    pub caption: String,
}

/// A file for other tools.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputFile {
    /// Name with extension.
    pub name: String,
    /// Content.
    pub bytes: Vec<u8>,
}

/// Result of an experiment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Procedure, in a paragraph.
    pub procedure: String,
    /// Tables of figures.
    pub tables: Vec<Table>,
    /// Pictures.
    pub pictures: Vec<NamedPicture>,
    /// Findings of the thesis.
    pub findings: Vec<Finding>,
    /// Volumes (.npy with a .json) and clouds (.ply) for other tools.
    pub files: Vec<OutputFile>,
}

impl Outcome {
    /// Adds a picture.
    pub(super) fn draw(&mut self, name: impl Into<String>, picture: Picture, caption: impl Into<String>) {
        self.pictures.push(NamedPicture { name: name.into(), picture, caption: caption.into() });
    }

    /// Adds a point cloud, name.ply: centres in the tracking frame, metres, and values.
    pub(super) fn keep_cloud(&mut self, name: &str, points: &[(DVec3, f32)]) {
        self.keep(format!("{name}.ply"), ply_bytes(points));
    }

    /// Adds a file for other tools.
    pub(super) fn keep(&mut self, name: impl Into<String>, bytes: Vec<u8>) {
        self.files.push(OutputFile { name: name.into(), bytes });
    }

    /// Adds a volume, name.npy and name.json, imaged from a number of sweeps.
    pub(super) fn keep_volume(
        &mut self,
        name: &str,
        volume: &Volume,
        statistic: Statistic,
        sweeps: usize,
    ) -> Result<(), ReportError> {
        let dense_updates = (volume.values.len() * sweeps) as u64;
        let mut info = VolumeInfo { statistic: statistic.name().into(), dense_updates, ..VolumeInfo::default() };
        info.updates = dense_updates;
        info.extra.insert("sweeps".into(), sweeps.into());
        let [npy, json] = volume_bytes(volume, &info)?;
        self.keep(format!("{name}.npy"), npy);
        self.keep(format!("{name}.json"), json);
        Ok(())
    }

    /// Adds a finding; `None` where the figures do not test it.
    pub(super) fn add_finding(&mut self, thesis: &str, holds: impl Into<Option<bool>>, ours: String) {
        self.findings.push(Finding { thesis: thesis.to_owned(), ours, holds: holds.into() });
    }

    /// The findings as a table.
    pub fn findings_table(&self) -> Table {
        let row = |finding: &Finding| vec![finding.thesis.clone(), finding.verdict().to_owned(), finding.ours.clone()];
        Table {
            head: ["finding of the thesis", "here", "our figures"].map(str::to_owned).to_vec(),
            rows: self.findings.iter().map(row).collect(),
            caption: String::new(),
        }
    }
}

/// Findings and tables as Markdown, a section each, without pictures.
pub fn markdown(done: &[(&Experiment, Outcome)]) -> String {
    let mut text = String::new();
    for (experiment, outcome) in done {
        let Experiment { name, title, section, .. } = experiment;
        text += &format!("\n## {title}\n\nThesis, section {section}; `experiment {name}`. {}\n", outcome.procedure);
        for table in std::iter::once(&outcome.findings_table()).chain(&outcome.tables) {
            text += &format!("\n{}", table.markdown());
            if !table.caption.is_empty() {
                text += &format!("\n{}\n", table.caption);
            }
        }
    }
    text
}

/// One HTML page with everything.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn report(done: &[(&Experiment, Outcome)]) -> Result<Report, ReportError> {
    let mut report = Report::new("The thesis' experiments repeated").intro(
        "Arbitrary Motion Synthetic Aperture Radar (Lund 2023) shows its findings in pictures. This report repeats \
         each experiment in simulation, by the thesis' method and by this program's, with figures and the truth.",
    );
    for (experiment, outcome) in done {
        let heading = format!("{} (thesis, section {})", experiment.title, experiment.section);
        let mut section = Section::new(heading).text(&outcome.procedure).table(outcome.findings_table());
        for table in &outcome.tables {
            section = section.table(table.clone());
        }
        for drawn in &outcome.pictures {
            section = section.figure(Figure::new(&drawn.picture, &drawn.caption)?);
        }
        if !outcome.files.is_empty() {
            let names: Vec<&str> = outcome.files.iter().map(|file| file.name.as_str()).collect();
            section = section.text(format!(
                "Files for other tools, in the folder {}: {}.",
                experiment.name,
                names.join(", ")
            ));
        }
        report = report.section(section);
    }
    Ok(report)
}
