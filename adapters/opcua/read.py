"""Reads volcomp-opcua with asyncua, an independent client, and prints what it finds as one JSON object.

Usage: read.py URL      Besides reading it subscribes to the state, and tries to write and to browse every node below the machine.
"""

import asyncio
import json
import sys

from asyncua import Client, ua

NAMESPACE = "urn:volcomp:opcua:1"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
MACHINE_TOOL = "http://opcfoundation.org/UA/MachineTool/"


class Changes:
    """Values that a subscription has brought."""

    def __init__(self):
        self.values = []

    def datachange_notification(self, node, value, data):
        self.values.append(value)


async def value_of(node):
    """Value and status of a variable; what is bad has no value."""
    found = await node.read_data_value(raise_on_bad_status=False)
    status = found.StatusCode.name
    return [found.Value.Value if status == "Good" else None, status]


async def walk(node, path, found):
    """Every variable below a node, by path."""
    for child in await node.get_children(ua.ObjectIds.HierarchicalReferences):
        name = await child.read_browse_name()
        place = f"{path}/{name.Name}" if path else name.Name
        if await child.read_node_class() == ua.NodeClass.Variable:
            value, status = await value_of(child)
            if isinstance(value, ua.LocalizedText):
                value = value.Text
            elif isinstance(value, ua.EUInformation):
                value = value.DisplayName.Text
            found[place] = [value if isinstance(value, (int, float, str, list, type(None))) else str(value), status]
        await walk(child, place, found)


async def main(url):
    async with Client(url, timeout=20) as client:
        own = await client.get_namespace_index(NAMESPACE)
        machinery = await client.get_namespace_index(MACHINERY)
        machine_tool = await client.get_namespace_index(MACHINE_TOOL)
        machine = await client.nodes.objects.get_child([f"{machinery}:Machines", f"{own}:MachineTool"])
        result = {"values": {}}
        result["machine"] = (await machine.read_display_name()).Text
        kind = client.get_node(await machine.read_type_definition())
        result["type"] = (await kind.read_browse_name()).Name
        result["type_is_of_40501"] = kind.nodeid.NamespaceIndex == machine_tool
        await walk(machine, "", result["values"])

        state = client.get_node(ua.NodeId("Compensation/State", own))
        monitored = await (await state.get_parent()).get_parent()
        result["element_of"] = (await monitored.read_browse_name()).Name
        changes = Changes()
        subscription = await client.create_subscription(200, changes)
        await subscription.subscribe_data_change(state)
        await asyncio.sleep(1.5)
        result["subscribed"] = changes.values

        # nothing can be written, no method can be called
        try:
            await state.write_value("off")
            result["written"] = True
        except ua.UaStatusCodeError as error:
            result["written"] = type(error).__name__
        methods = await machine.get_children_descriptions(nodeclassmask=ua.NodeClass.Method)
        result["methods"] = len(methods)
        print(json.dumps(result))


asyncio.run(main(sys.argv[1]))
