//! Adapters: which exist, which of them are usable, which one is chosen.

use std::fmt;

use crate::error::GpuError;
use crate::wait::ready;

/// What kind of device an adapter is, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A graphics card.
    Discrete,
    /// Integrated into the processor.
    Integrated,
    /// A share of a card in a virtual machine.
    Virtual,
    /// The driver does not report it.
    Other,
    /// A software renderer.
    Cpu,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AdapterKind::Discrete => "discrete",
            AdapterKind::Integrated => "integrated",
            AdapterKind::Virtual => "virtual",
            AdapterKind::Other => "other",
            AdapterKind::Cpu => "cpu",
        })
    }
}

/// Optional abilities of a device; each tier contains the previous one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// The minimum.
    Baseline,
    /// Subgroup operations in compute shaders.
    Subgroups,
}

impl fmt::Display for Tier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Tier::Baseline => "baseline",
            Tier::Subgroups => "subgroups",
        })
    }
}

/// The limits of a device that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuLimits {
    /// Largest buffer, bytes.
    pub buffer_bytes: u64,
    /// Largest storage buffer a kernel can see, bytes.
    pub storage_binding_bytes: u64,
    /// Largest uniform buffer a kernel can see, bytes.
    pub uniform_binding_bytes: u64,
    /// Storage buffers of one kernel.
    pub storage_buffers_per_kernel: u32,
    /// Bind groups of one kernel.
    pub bind_groups: u32,
    /// Invocations of one workgroup.
    pub workgroup_invocations: u32,
    /// Shared memory of one workgroup, bytes.
    pub workgroup_storage_bytes: u32,
    /// Workgroups of a dispatch in each dimension.
    pub workgroups_per_dimension: u32,
    /// Alignment of uniform data, bytes.
    pub uniform_alignment: u32,
}

impl From<&wgpu::Limits> for GpuLimits {
    fn from(limits: &wgpu::Limits) -> Self {
        GpuLimits {
            buffer_bytes: limits.max_buffer_size,
            storage_binding_bytes: limits.max_storage_buffer_binding_size,
            uniform_binding_bytes: limits.max_uniform_buffer_binding_size,
            storage_buffers_per_kernel: limits.max_storage_buffers_per_shader_stage,
            bind_groups: limits.max_bind_groups,
            workgroup_invocations: limits.max_compute_invocations_per_workgroup,
            workgroup_storage_bytes: limits.max_compute_workgroup_storage_size,
            workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
            uniform_alignment: limits.min_uniform_buffer_offset_alignment,
        }
    }
}

/// Minimum of every device. The binding size is WebGPU's minimum; the number of storage buffers is what the general
/// variant of a path kernel binds, which Vulkan drivers of the last ten years exceed.
const REQUIRED: GpuLimits = GpuLimits {
    buffer_bytes: 128 << 20,
    storage_binding_bytes: 128 << 20,
    uniform_binding_bytes: 16 << 10,
    storage_buffers_per_kernel: 25,
    bind_groups: 4,
    workgroup_invocations: 256,
    workgroup_storage_bytes: 16 << 10,
    workgroups_per_dimension: 65_535,
    uniform_alignment: 256,
};

impl GpuLimits {
    /// The first limit that is too small, as a message.
    fn check(&self) -> Result<(), String> {
        let required = [
            ("buffer_bytes", self.buffer_bytes, REQUIRED.buffer_bytes),
            ("storage_binding_bytes", self.storage_binding_bytes, REQUIRED.storage_binding_bytes),
            ("uniform_binding_bytes", self.uniform_binding_bytes, REQUIRED.uniform_binding_bytes),
            (
                "storage_buffers_per_kernel",
                self.storage_buffers_per_kernel.into(),
                REQUIRED.storage_buffers_per_kernel.into(),
            ),
            ("bind_groups", self.bind_groups.into(), REQUIRED.bind_groups.into()),
            ("workgroup_invocations", self.workgroup_invocations.into(), REQUIRED.workgroup_invocations.into()),
            ("workgroup_storage_bytes", self.workgroup_storage_bytes.into(), REQUIRED.workgroup_storage_bytes.into()),
            (
                "workgroups_per_dimension",
                self.workgroups_per_dimension.into(),
                REQUIRED.workgroups_per_dimension.into(),
            ),
        ];
        for (name, offered, needed) in required {
            if offered < needed {
                return Err(format!("its limit {name} is {offered}, at least {needed} is needed"));
            }
        }
        if self.uniform_alignment > REQUIRED.uniform_alignment {
            return Err(format!(
                "its uniform_alignment is {}, at most {} is supported",
                self.uniform_alignment, REQUIRED.uniform_alignment
            ));
        }
        Ok(())
    }
}

/// An adapter as reported by its driver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterReport {
    /// Position in the list; `--adapter` takes it.
    pub index: usize,
    /// Name the driver gives it; `--adapter` takes a part of it.
    pub name: String,
    /// Kind.
    pub kind: AdapterKind,
    /// API, such as `vulkan`.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// Best tier.
    pub tier: Tier,
    /// Limits.
    pub limits: GpuLimits,
    /// Why it cannot be used, if it cannot.
    pub unusable: Option<String>,
}

impl AdapterReport {
    fn new(index: usize, adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let limits = GpuLimits::from(&adapter.limits());
        let compute = adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS);
        let unusable = if compute { limits.check().err() } else { Some("it does not run compute shaders".to_owned()) };
        AdapterReport {
            index,
            name: info.name.clone(),
            kind: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
                wgpu::DeviceType::Cpu => AdapterKind::Cpu,
                wgpu::DeviceType::Other => AdapterKind::Other,
            },
            backend: info.backend.to_string(),
            driver: [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned(),
            tier: if adapter.features().contains(wgpu::Features::SUBGROUP) { Tier::Subgroups } else { Tier::Baseline },
            limits,
            unusable,
        }
    }
}

/// Format of targets: 32-bit floats where the device can blend them, else 16-bit ones. The reason where it can blend
/// neither.
pub(crate) fn target_format(adapter: &wgpu::Adapter) -> Result<wgpu::TextureFormat, String> {
    if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::VERTEX_STORAGE) {
        return Err(
            "this device cannot draw: it has no VERTEX_STORAGE, vertex shaders see no storage buffer".to_owned()
        );
    }
    if adapter.features().contains(wgpu::Features::FLOAT32_BLENDABLE) {
        return Ok(wgpu::TextureFormat::Rgba32Float);
    }
    let half = adapter.get_texture_format_features(wgpu::TextureFormat::Rgba16Float);
    let can_draw = half.allowed_usages.contains(wgpu::TextureUsages::RENDER_ATTACHMENT);
    if can_draw && half.flags.contains(wgpu::TextureFormatFeatureFlags::BLENDABLE) {
        return Ok(wgpu::TextureFormat::Rgba16Float);
    }
    Err("this device cannot draw: it has neither FLOAT32_BLENDABLE nor blendable rgba16float targets".to_owned())
}

/// Percentage of the memory reported by the driver beyond which creating a buffer fails, before the device itself
/// would.
const DRIVER_MEMORY_PERCENT: u8 = 95;

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.memory_budget_thresholds.for_resource_creation = Some(DRIVER_MEMORY_PERCENT);
    wgpu::Instance::new(descriptor)
}

fn enumerate() -> Vec<(AdapterReport, wgpu::Adapter)> {
    let found = ready(instance().enumerate_adapters(wgpu::Backends::all())).unwrap_or_default();
    found.into_iter().enumerate().map(|(index, adapter)| (AdapterReport::new(index, &adapter), adapter)).collect()
}

/// Every adapter of this machine, in the driver's order.
pub fn adapters() -> Vec<AdapterReport> {
    enumerate().into_iter().map(|(report, _)| report).collect()
}

/// The adapter `wanted` names by index or part of its name, or the best usable one.
pub(crate) fn choose(wanted: Option<&str>) -> Result<(AdapterReport, wgpu::Adapter), GpuError> {
    let found = enumerate();
    let reports: Vec<AdapterReport> = found.iter().map(|(report, _)| report.clone()).collect();
    let index = choose_index(&reports, wanted)?;
    found.into_iter().nth(index).ok_or_else(|| no_adapter("none answered".to_owned()))
}

const INSTALL: &str = "install a Vulkan driver: your GPU vendor's, or Mesa's software renderer (Debian and Ubuntu: \
                       apt-get install mesa-vulkan-drivers)";

fn no_adapter(problem: String) -> GpuError {
    GpuError::NoAdapter { problem, remedy: INSTALL.to_owned() }
}

fn choose_index(reports: &[AdapterReport], wanted: Option<&str>) -> Result<usize, GpuError> {
    if reports.is_empty() {
        return Err(no_adapter("no Vulkan driver answered".to_owned()));
    }
    let listed = || {
        let names = reports.iter().map(|report| format!("{}: {} ({})", report.index, report.name, report.kind));
        names.collect::<Vec<_>>().join(", ")
    };
    if let Some(wanted) = wanted {
        let by_index = wanted.trim().parse().ok().filter(|&index: &usize| index < reports.len());
        let needle = wanted.trim().to_lowercase();
        let by_name = || {
            let matching = reports.iter().filter(|report| report.name.to_lowercase().contains(&needle));
            matching.min_by_key(|report| (report.unusable.is_some(), report.kind)).map(|report| report.index)
        };
        let Some(index) = by_index.or_else(by_name) else {
            return Err(GpuError::NoAdapter {
                problem: format!("none is called `{wanted}`"),
                remedy: format!("name one of these by number or part of its name: {}", listed()),
            });
        };
        return match &reports[index].unusable {
            None => Ok(index),
            Some(why) => Err(GpuError::NoAdapter {
                problem: format!("`{}` cannot be used: {why}", reports[index].name),
                remedy: format!("choose another: {}", listed()),
            }),
        };
    }
    let usable = reports.iter().filter(|report| report.unusable.is_none());
    usable.min_by_key(|report| report.kind).map(|report| report.index).ok_or_else(|| {
        let reasons =
            reports.iter().filter_map(|report| report.unusable.as_ref().map(|why| format!("`{}`: {why}", report.name)));
        no_adapter(reasons.collect::<Vec<_>>().join("; "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(index: usize, name: &str, kind: AdapterKind, unusable: Option<&str>) -> AdapterReport {
        AdapterReport {
            index,
            name: name.to_owned(),
            kind,
            backend: "vulkan".to_owned(),
            driver: String::new(),
            tier: Tier::Baseline,
            limits: REQUIRED,
            unusable: unusable.map(str::to_owned),
        }
    }

    fn some() -> Vec<AdapterReport> {
        vec![
            report(0, "llvmpipe", AdapterKind::Cpu, None),
            report(1, "Iris", AdapterKind::Integrated, None),
            report(2, "Old Card", AdapterKind::Discrete, Some("its limit bind_groups is 2, at least 4 is needed")),
            report(3, "Big Card", AdapterKind::Discrete, None),
        ]
    }

    #[test]
    fn a_card_is_preferred_and_software_comes_last() {
        assert_eq!(choose_index(&some(), None), Ok(3));
        assert_eq!(choose_index(&some()[..1], None), Ok(0));
        assert_eq!(choose_index(&some()[..2], None), Ok(1));
    }

    #[test]
    fn an_adapter_is_named_by_index_or_part_of_its_name() {
        assert_eq!(choose_index(&some(), Some("0")), Ok(0));
        assert_eq!(choose_index(&some(), Some("LLVM")), Ok(0));
        assert_eq!(choose_index(&some(), Some("card")), Ok(3), "a usable one wins");
        let unknown = choose_index(&some(), Some("voodoo")).expect_err("chosen").to_string();
        assert!(unknown.contains("voodoo") && unknown.contains("3: Big Card"), "{unknown}");
        let unusable = choose_index(&some(), Some("2")).expect_err("chosen").to_string();
        assert!(unusable.contains("bind_groups"), "{unusable}");
    }

    #[test]
    fn no_adapter_says_what_to_install() {
        let none = choose_index(&[], None).expect_err("chosen").to_string();
        assert!(none.contains("mesa-vulkan-drivers"), "{none}");
        let bad = choose_index(&[report(0, "x", AdapterKind::Cpu, Some("too old"))], None).expect_err("chosen");
        assert!(bad.to_string().contains("too old"), "{bad}");
    }

    #[test]
    fn the_required_limits_hold_every_kernel() {
        for kernel in surfelcast_shaders::kernels() {
            let linked = surfelcast_shaders::link(&kernel.name, surfelcast_shaders::Features::ALL).expect("links");
            let bindings = &linked.reflection.bindings;
            let storage = bindings.iter().filter(|b| b.access.is_storage()).count();
            assert!(storage <= REQUIRED.storage_buffers_per_kernel as usize, "{} binds {storage}", kernel.name);
            assert!(bindings.iter().all(|b| b.group < REQUIRED.bind_groups), "{}", kernel.name);
            let invocations: u32 = linked.reflection.workgroup_size.iter().product();
            assert!(invocations <= REQUIRED.workgroup_invocations, "{}: {invocations}", kernel.name);
        }
    }

    #[test]
    fn each_limit_is_checked() {
        assert_eq!(REQUIRED.check(), Ok(()));
        let small = GpuLimits { storage_buffers_per_kernel: 4, ..REQUIRED };
        assert_eq!(small.check(), Err("its limit storage_buffers_per_kernel is 4, at least 25 is needed".to_owned()));
        assert!(GpuLimits { uniform_alignment: 512, ..REQUIRED }.check().is_err());
    }
}
