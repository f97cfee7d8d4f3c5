"""Model of the link (UART, USB adapter, CAN bus) between the virtual sweeper and its host."""
