"""The station's outer state for others: over OPC UA, and over Modbus TCP. Each runs in a process of its own."""
