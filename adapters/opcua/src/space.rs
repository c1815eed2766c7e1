//! Nodes: the types of the companion specifications, one machine tool, and its compensation.
//!
//! `Objects/Machines/MachineTool` is a `MachineToolType` (OPC 40501-1) with all its mandatory children. What volcompd does
//! not know (operation mode, production) is `Bad_NotSupported`. The compensation is an element of `Monitoring`.

use std::collections::BTreeMap;
use std::sync::Arc;

use opcua::nodes::{
    AccessLevel, EventNotifier, ImportedItem, NodeBase as _, NodeSet2Import, NodeSetImport,
    NodeSetNamespaceMapper, NodeType, Object, ObjectType, TypeTree, Variable,
};
use opcua::server::ServerHandle;
use opcua::server::address_space::AddressSpace;
use opcua::server::node_manager::NodeManagerBuilder;
use opcua::server::node_manager::memory::{SimpleNodeManager, simple_node_manager_imports};
use opcua::types::{
    AttributeId, BrowseDirection, DataTypeId, DataValue, DateTime, EUInformation, ExtensionObject,
    LocalizedText, NodeClass, NodeId, ObjectTypeId, QualifiedName, ReferenceTypeId, StatusCode,
    VariableTypeId, Variant,
};
use serde_json::Value;

use crate::values::{self, ITEMS, Kind, Unit};

/// Namespace of volcomp's own nodes.
pub const NAMESPACE: &str = "urn:volcomp:opcua:1";
const DI: &str = "http://opcfoundation.org/UA/DI/";
const MACHINERY: &str = "http://opcfoundation.org/UA/Machinery/";
const MACHINE_TOOL: &str = "http://opcfoundation.org/UA/MachineTool/";

/// In the order in which they need each other.
const NODE_SETS: [&str; 6] = [
    include_str!("../nodesets/Opc.Ua.Di.NodeSet2.xml"),
    include_str!("../nodesets/Opc.Ua.IA.NodeSet2.xml"),
    include_str!("../nodesets/Opc.Ua.Machinery.NodeSet2.xml"),
    include_str!("../nodesets/opc.ua.isa95-jobcontrol.nodeset2.xml"),
    include_str!("../nodesets/Opc.Ua.Machinery.Jobs.Nodeset2.xml"),
    include_str!("../nodesets/Opc.Ua.MachineTool.NodeSet2.xml"),
];
/// `Machines` of the Machinery model.
const MACHINES: u32 = 1001;
/// `MachineToolType`, `ElementMonitoringType`, `SoftwareIdentificationType` of the machine tool model.
const MACHINE_TOOL_TYPE: u32 = 13;
const ELEMENT_MONITORING_TYPE: u32 = 23;
const SOFTWARE_IDENTIFICATION_TYPE: u32 = 43;

/// Deepest nesting of instances; the models need five.
const DEPTH_MAX: usize = 16;

/// Claims [`NAMESPACE`]; its nodes come later.
struct Own;

impl NodeSetImport for Own {
    fn register_namespaces(&self, namespaces: &mut NodeSetNamespaceMapper) {
        namespaces.add_namespace(NAMESPACE, 1);
    }

    fn get_own_namespaces(&self) -> Vec<String> {
        vec![NAMESPACE.to_owned()]
    }

    fn load<'a>(&'a self, _: &'a NodeSetNamespaceMapper) -> Box<dyn Iterator<Item = ImportedItem> + 'a> {
        Box::new(std::iter::empty())
    }
}

/// The node manager with all types.
///
/// # Errors
/// A node set is not readable.
pub fn managers() -> Result<Vec<impl NodeManagerBuilder + 'static>, String> {
    let mut imports: Vec<Box<dyn NodeSetImport>> = Vec::new();
    for text in NODE_SETS {
        let import = NodeSet2Import::new_str("en", text, Vec::new()).map_err(|e| e.to_string())?;
        imports.push(Box::new(import));
    }
    imports.push(Box::new(Own));
    Ok(vec![simple_node_manager_imports(imports, "volcomp")])
}

/// What the daemon does not know of its machine.
#[derive(Debug, Default)]
pub struct Identification {
    /// Manufacturer of the machine tool.
    pub manufacturer: Option<String>,
    /// Serial number.
    pub serial_number: Option<String>,
    /// Globally unique URI.
    pub product_instance_uri: Option<String>,
}

/// Indices of the namespaces in this server.
#[derive(Debug, Clone, Copy)]
struct Namespaces {
    own: u16,
    di: u16,
    machinery: u16,
    machine_tool: u16,
}

/// The nodes, and the way to their values.
pub struct Space {
    manager: Arc<SimpleNodeManager>,
    handle: ServerHandle,
    namespaces: Namespaces,
    /// Axis nodes that exist.
    axes: BTreeMap<String, NodeId>,
    /// Display name of the machine.
    machine: String,
}

impl Space {
    /// Lays out the nodes.
    ///
    /// # Errors
    /// A type is missing from the models.
    pub fn new(handle: &ServerHandle) -> Result<Self, String> {
        let manager =
            handle.node_managers().get_of_type::<SimpleNodeManager>().ok_or("the node manager is missing")?;
        let index = |uri: &str| handle.get_namespace_index(uri).ok_or(format!("no namespace {uri}"));
        let namespaces = Namespaces {
            own: index(NAMESPACE)?,
            di: index(DI)?,
            machinery: index(MACHINERY)?,
            machine_tool: index(MACHINE_TOOL)?,
        };
        {
            let tree = handle.type_tree().read();
            let mut space = manager.address_space().write();
            lay_out(&mut space, &*tree, namespaces)?;
        }
        let machine = String::new();
        Ok(Self { manager, handle: handle.clone(), namespaces, axes: BTreeMap::new(), machine })
    }

    /// Writes a reading to the nodes; `None`: the daemon does not answer.
    ///
    /// # Errors
    /// A node is missing.
    pub fn publish(&mut self, status: Option<&Value>, identification: &Identification) -> Result<(), String> {
        let own = self.namespaces.own;
        let mut all: Vec<(NodeId, DataValue)> = Vec::new();
        let answers = NodeId::new(own, "Compensation/DaemonAnswers");
        all.push((answers, DataValue::new_now(status.is_some())));
        for item in ITEMS {
            let id = NodeId::new(own, format!("Compensation/{}", item.name));
            all.push((id, status.map_or_else(silent, |status| known(values::value(item, status)))));
        }
        let offsets = status.map(values::offsets).unwrap_or_default();
        for (folder, axis, _, unit) in &offsets {
            self.axis(folder, axis, *unit);
        }
        for (path, id) in &self.axes {
            let found = offsets.iter().find(|(folder, axis, ..)| *path == format!("{folder}/{axis}"));
            let value = || known(found.map(|(_, _, value, _)| Variant::from(*value)));
            all.push((id.clone(), status.map_or_else(silent, |_| value())));
        }
        for (path, value) in identify(status, identification) {
            all.push((NodeId::new(own, path), value));
        }
        self.manager
            .set_values(self.handle.subscriptions(), all.iter().map(|(id, value)| (id, None, value.clone())))
            .map_err(|code| format!("values are not taken: {code}"))?;
        if let Some(name) = status.map(values::machine).filter(|name| *name != self.machine) {
            self.machine = name.to_owned();
            let id = NodeId::new(own, "MachineTool");
            let text = Variant::from(LocalizedText::from(name));
            self.manager
                .set_attribute(self.handle.subscriptions(), &id, AttributeId::DisplayName, text)
                .map_err(|code| format!("the name is not taken: {code}"))?;
        }
        Ok(())
    }

    /// Node of an axis; made where it is new.
    fn axis(&mut self, folder: &str, axis: &str, unit: Unit) {
        let path = format!("{folder}/{axis}");
        if self.axes.contains_key(&path) {
            return;
        }
        let own = self.namespaces.own;
        let parent = NodeId::new(own, format!("Compensation/{folder}"));
        let mut space = self.manager.address_space().write();
        let id = variable(
            &mut space,
            own,
            (&parent, ReferenceTypeId::HasComponent),
            &format!("Compensation/{path}"),
            (axis, "Offset of the axis, added to its nominal position"),
            DataTypeId::Double.into(),
            Some(unit),
        );
        self.axes.insert(path, id);
    }
}

/// A value that the daemon would have to say.
fn silent() -> DataValue {
    bad(StatusCode::BadNoCommunication)
}

fn bad(status: StatusCode) -> DataValue {
    DataValue::new_now_status(Variant::Empty, status)
}

fn known(value: Option<Variant>) -> DataValue {
    value.map_or_else(|| bad(StatusCode::BadNoData), DataValue::new_now)
}

/// Values of the identification, by path.
fn identify(status: Option<&Value>, identification: &Identification) -> Vec<(String, DataValue)> {
    let text = |value: &Option<String>| value.as_deref().map(Variant::from);
    let localised = |value: &Option<String>| value.as_deref().map(|t| Variant::from(LocalizedText::from(t)));
    let given =
        |value: Option<Variant>| value.map_or_else(|| bad(StatusCode::BadNotSupported), DataValue::new_now);
    let place = "MachineTool/Identification";
    let software = format!("{place}/SoftwareIdentification/volcompd");
    let version = status.and_then(|s| s.get("version")).and_then(Value::as_str).map(Variant::from);
    vec![
        (format!("{place}/Manufacturer"), given(localised(&identification.manufacturer))),
        (format!("{place}/SerialNumber"), given(text(&identification.serial_number))),
        (format!("{place}/ProductInstanceUri"), given(text(&identification.product_instance_uri))),
        (format!("{software}/Identifier"), DataValue::new_now("volcompd")),
        (format!("{software}/SoftwareRevision"), status.map_or_else(silent, |_| known(version))),
    ]
}

fn lay_out(space: &mut AddressSpace, tree: &dyn TypeTree, namespaces: Namespaces) -> Result<(), String> {
    let Namespaces { own, di, machinery, machine_tool } = namespaces;
    let machines = NodeId::new(machinery, MACHINES);
    let machine_tool_type = NodeId::new(machine_tool, MACHINE_TOOL_TYPE);
    for (id, what) in [(&machines, "Machines"), (&machine_tool_type, "MachineToolType")] {
        if !space.node_exists(id) {
            return Err(format!("no {what} in the node sets"));
        }
    }
    let machine = object(
        space,
        own,
        (&machines, ReferenceTypeId::Organizes.into()),
        "MachineTool",
        "MachineTool",
        &machine_tool_type,
    );
    instantiate(space, tree, own, &machine_tool_type, &machine, "MachineTool", 0);
    let identification = NodeId::new(own, "MachineTool/Identification");
    let monitoring = NodeId::new(own, "MachineTool/Monitoring");
    for id in [&identification, &monitoring] {
        if !space.node_exists(id) {
            return Err(format!("no {id} of MachineToolType"));
        }
    }
    // the software that is at work, where the model has it
    let folder = NodeId::new(own, "MachineTool/Identification/SoftwareIdentification");
    if !space.node_exists(&folder) {
        let list = Object::new(
            &folder,
            QualifiedName::new(machine_tool, "SoftwareIdentification"),
            "SoftwareIdentification",
            EventNotifier::empty(),
        );
        insert(
            space,
            list,
            &identification,
            ReferenceTypeId::HasComponent.into(),
            &ObjectTypeId::FolderType.into(),
        );
    }
    let software_type = NodeId::new(machine_tool, SOFTWARE_IDENTIFICATION_TYPE);
    let path = "MachineTool/Identification/SoftwareIdentification/volcompd";
    let software =
        object(space, own, (&folder, ReferenceTypeId::HasComponent.into()), path, "volcompd", &software_type);
    instantiate(space, tree, own, &software_type, &software, path, 0);
    let maker = NodeId::new(own, format!("{path}/Manufacturer"));
    if !space.node_exists(&maker) {
        let name = QualifiedName::new(di, "Manufacturer");
        let node = Variable::new_data_value(
            &maker,
            name,
            "Manufacturer",
            DataTypeId::LocalizedText,
            None,
            None,
            LocalizedText::from("volcomp"),
        );
        insert(
            space,
            node,
            &software,
            ReferenceTypeId::HasProperty.into(),
            &VariableTypeId::PropertyType.into(),
        );
    }
    compensation(space, tree, namespaces, &monitoring);
    Ok(())
}

/// The compensation: an element of the monitoring, of a type of its own.
fn compensation(space: &mut AddressSpace, tree: &dyn TypeTree, namespaces: Namespaces, monitoring: &NodeId) {
    let Namespaces { own, machine_tool, .. } = namespaces;
    let element = NodeId::new(machine_tool, ELEMENT_MONITORING_TYPE);
    let type_id = NodeId::new(own, "CompensationMonitoringType");
    let name = QualifiedName::new(own, "CompensationMonitoringType");
    space.insert::<_, ReferenceTypeId>(
        ObjectType::new(&type_id, name, "CompensationMonitoringType", false),
        None,
    );
    space.insert_reference(&element, &type_id, ReferenceTypeId::HasSubtype);
    let place = object(
        space,
        own,
        (monitoring, ReferenceTypeId::HasComponent.into()),
        "Compensation",
        "Compensation",
        &type_id,
    );
    instantiate(space, tree, own, &element, &place, "Compensation", 0);
    if let Some(NodeType::Variable(name)) = space.find_mut(&NodeId::new(own, "Compensation/Name")) {
        name.set_data_value(DataValue::new_now("Compensation"));
    }
    let parent = (&place, ReferenceTypeId::HasComponent);
    let answers =
        ("DaemonAnswers", "volcompd answers; where not, values of the compensation are Bad_NoCommunication");
    variable(space, own, parent, "Compensation/DaemonAnswers", answers, DataTypeId::Boolean.into(), None);
    for item in ITEMS {
        let data_type = match item.kind {
            Kind::Yes => DataTypeId::Boolean,
            Kind::Number => DataTypeId::Double,
            Kind::Count => DataTypeId::UInt64,
            Kind::Text | Kind::FileName | Kind::Texts => DataTypeId::String,
        };
        let path = format!("Compensation/{}", item.name);
        let id =
            variable(space, own, parent, &path, (item.name, item.description), data_type.into(), item.unit);
        if let (Kind::Texts, Some(NodeType::Variable(node))) = (item.kind, space.find_mut(&id)) {
            node.set_value_rank(1);
        }
    }
    for folder in ["Offsets", "AppliedOffsets"] {
        object(
            space,
            own,
            (&place, ReferenceTypeId::HasComponent.into()),
            &format!("Compensation/{folder}"),
            folder,
            &ObjectTypeId::FolderType.into(),
        );
    }
}

/// Inserts a node below its parent, with its type.
fn insert(
    space: &mut AddressSpace,
    node: impl Into<NodeType>,
    parent: &NodeId,
    reference: NodeId,
    type_id: &NodeId,
) {
    let node = node.into();
    let id = node.as_node().node_id().clone();
    space.insert::<_, ReferenceTypeId>(node, None);
    space.insert_reference(parent, &id, reference);
    space.insert_reference(&id, type_id, ReferenceTypeId::HasTypeDefinition);
}

fn object(
    space: &mut AddressSpace,
    own: u16,
    (parent, reference): (&NodeId, NodeId),
    path: &str,
    name: &str,
    type_id: &NodeId,
) -> NodeId {
    let id = NodeId::new(own, path);
    let node = Object::new(&id, QualifiedName::new(own, name), name, EventNotifier::empty());
    insert(space, node, parent, reference, type_id);
    id
}

/// A variable that can be read; a quantity has its unit.
fn variable(
    space: &mut AddressSpace,
    own: u16,
    (parent, reference): (&NodeId, ReferenceTypeId),
    path: &str,
    (name, description): (&str, &str),
    data_type: NodeId,
    unit: Option<Unit>,
) -> NodeId {
    let id = NodeId::new(own, path);
    let mut node = Variable::new_data_value(
        &id,
        QualifiedName::new(own, name),
        name,
        data_type,
        Some(-1),
        None,
        Variant::Empty,
    );
    node.set_description(LocalizedText::from(description));
    node.set_data_value(silent());
    let type_id =
        if unit.is_some() { VariableTypeId::AnalogUnitType } else { VariableTypeId::BaseDataVariableType };
    insert(space, node, parent, reference.into(), &type_id.into());
    if let Some((unit_id, symbol, words)) = unit {
        let information = EUInformation {
            namespace_uri: "http://www.opcfoundation.org/UA/units/un/cefact".into(),
            unit_id,
            display_name: symbol.into(),
            description: words.into(),
        };
        let unit = NodeId::new(own, format!("{path}/EngineeringUnits"));
        let value = ExtensionObject::from_message(information);
        let node = Variable::new_data_value(
            &unit,
            "EngineeringUnits",
            "EngineeringUnits",
            DataTypeId::EUInformation,
            Some(-1),
            None,
            value,
        );
        insert(space, node, &id, ReferenceTypeId::HasProperty.into(), &VariableTypeId::PropertyType.into());
    }
    id
}

/// Gives `target` the mandatory children of `source`, of the type that this has, and of the types above.
fn instantiate(
    space: &mut AddressSpace,
    tree: &dyn TypeTree,
    own: u16,
    source: &NodeId,
    target: &NodeId,
    path: &str,
    depth: usize,
) {
    if depth > DEPTH_MAX {
        return;
    }
    let mut sources = vec![source.clone()];
    let is_type = space.find(source).is_some_and(|node| node.node_class() == NodeClass::ObjectType);
    let mut above = if is_type {
        Some(source.clone())
    } else {
        first(space, tree, source, ReferenceTypeId::HasTypeDefinition, BrowseDirection::Forward)
    };
    while let Some(id) = above {
        above = first(space, tree, &id, ReferenceTypeId::HasSubtype, BrowseDirection::Inverse);
        if !sources.contains(&id) {
            sources.push(id);
        }
    }
    for source in sources {
        for (reference, child) in children(space, tree, &source) {
            if first(space, tree, &child, ReferenceTypeId::HasModellingRule, BrowseDirection::Forward)
                .is_none_or(|rule| rule != opcua::types::ObjectId::ModellingRule_Mandatory)
            {
                continue;
            }
            let Some(node) = space.find(&child) else { continue };
            let name = node.as_node().browse_name().clone();
            let label = node.as_node().display_name().clone();
            let path = format!("{path}/{}", name.name);
            let id = NodeId::new(own, path.clone());
            if space.node_exists(&id) {
                continue;
            }
            let copy: NodeType = match node {
                NodeType::Object(_) => Object::new(&id, name, label, EventNotifier::empty()).into(),
                NodeType::Variable(from) => {
                    let mut to = Variable::new_data_value(
                        &id,
                        name,
                        label,
                        from.data_type(),
                        Some(from.value_rank()),
                        None,
                        Variant::Empty,
                    );
                    to.set_access_level(AccessLevel::CURRENT_READ);
                    to.set_data_value(DataValue::new_at_status(
                        Variant::Empty,
                        DateTime::now(),
                        StatusCode::BadNotSupported,
                    ));
                    to.into()
                }
                // methods: nothing can be called
                _ => continue,
            };
            let type_id =
                first(space, tree, &child, ReferenceTypeId::HasTypeDefinition, BrowseDirection::Forward)
                    .unwrap_or_else(|| ObjectTypeId::BaseObjectType.into());
            insert(space, copy, target, reference, &type_id);
            instantiate(space, tree, own, &child, &id, &path, depth + 1);
        }
    }
}

/// The first node at the other end of a reference.
fn first(
    space: &AddressSpace,
    tree: &dyn TypeTree,
    id: &NodeId,
    reference: ReferenceTypeId,
    direction: BrowseDirection,
) -> Option<NodeId> {
    let filter = Some((reference, false));
    space.find_references(id, filter, tree, direction).map(|found| found.target_node.clone()).next()
}

/// Parts, with the kind of their reference.
fn children(space: &AddressSpace, tree: &dyn TypeTree, id: &NodeId) -> Vec<(NodeId, NodeId)> {
    let kinds = [ReferenceTypeId::HasComponent, ReferenceTypeId::HasProperty, ReferenceTypeId::HasAddIn];
    let mut all: Vec<(NodeId, NodeId)> = Vec::new();
    for kind in kinds {
        let found = space.find_references(id, Some((kind, false)), tree, BrowseDirection::Forward);
        all.extend(found.map(|r| (r.reference_type.clone(), r.target_node.clone())));
    }
    all
}
